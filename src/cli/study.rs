//! This is the command `gspotential study`.

use std::path::PathBuf;

use clap::Args;

use super::measure::MeasureArgs;
use crate::error::Result;
use crate::report::{Column, Table};
use crate::scene::SceneSource;
use crate::study::{self, Listed, Options, State, StudyName};

const EXAMPLES: &str = "\
Examples:
  gspotential study ablation --scene scenes/garden scenes/bonsai
  gspotential study cloud --max-size 320 --max-points 60000 --iterations 1000 --seeds 0
  gspotential study need --scene scenes/garden --list

Runs go to OUT/runs/ and are never trained twice: a study that was interrupted, or that had a run
fail, goes on where it stopped, and studies with the same options share runs in one OUT. A run of
another config or scene under the same name is refused. The report is OUT/STUDY.md, with the
figures in .csv and .json and the pictures in .svg beside it; where a study is about several
methods, OUT/STUDY-renders.png has their renders side by side. OUT/STUDY.html shows the runs and
their renders on one page.";

/// Train what a table or figure of the paper needs, and report it
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct StudyArgs {
    /// Which study
    #[arg(value_enum, value_name = "NAME")]
    name: StudyName,

    /// Scenes: folders, or `builtin[:WIDTH]` or `builtin:object[:WIDTH]`
    #[arg(long, value_name = "DIR", num_args = 1.., default_value = "builtin")]
    scene: Vec<SceneSource>,

    /// Folder for the runs and the report
    #[arg(long, value_name = "OUT", default_value = "studies")]
    out: PathBuf,

    /// Training iterations of every run, at most [default: its preset's]
    #[arg(long, value_name = "N")]
    iterations: Option<u32>,

    /// Scale images down until their longer side is PX pixels [preset: 1600 wide]
    #[arg(long, value_name = "PX")]
    max_size: Option<u32>,

    /// Thin the point cloud evenly to N points [preset: one for each training pixel, in `gspotential` and `fast` one for four]
    #[arg(long, value_name = "N")]
    max_points: Option<usize>,

    /// Seeds, for means and their spread
    #[arg(
        long,
        value_name = "A,B,...",
        value_delimiter = ',',
        default_value = "0,1,2"
    )]
    seeds: Vec<u64>,

    /// Change one config value of every run; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,

    #[command(flatten)]
    measure: MeasureArgs,

    /// List the study's runs and what there is of each, and train nothing
    #[arg(long)]
    list: bool,
}

impl StudyArgs {
    pub(crate) fn run(self) -> Result<()> {
        let options = Options {
            scenes: self.scene,
            out: self.out,
            seeds: self.seeds,
            iterations: self.iterations,
            max_size: self.max_size,
            max_points: self.max_points,
            settings: self.settings,
            measure: self.measure.options()?,
        };
        if self.list {
            return super::print(&listed(study::list(self.name, &options)?));
        }
        let report = study::run(self.name, &options)?;
        super::print(&report)?;
        let path = options.out.join(format!("{}.md", self.name.name()));
        log::info!("wrote {}", path.display());
        Ok(())
    }
}

fn listed(runs: Vec<Listed>) -> String {
    let columns = [
        Column::text("run", "run"),
        Column::quantity("state", "state"),
    ];
    let mut table = Table::new("runs", &columns);
    for Listed { run, state } in runs {
        let state = match state {
            State::ToTrain => "to train",
            State::ToMeasure => "to measure",
            State::Done => "done",
        };
        table.row([run.into(), state.into()]);
    }
    table.to_string()
}
