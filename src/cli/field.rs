//! This is the command `gspotential field`.

use std::path::PathBuf;

use clap::Args;

use crate::config::{Config, PRESETS};
use crate::error::{Error, Result};
use crate::files::{create_dir, write_file};
use crate::pipeline::{self, FieldReport};
use crate::report::{Cell, Column, Table, agreement_table};
use crate::scene::{LoadOptions, SceneSource};

const EXAMPLES: &str = "\
Examples:
  gspotential field --scene scenes/garden
  gspotential field --scene scenes/garden --out garden-field
  gspotential field --scene scenes/garden --set field.sigma=3 --train-views a.jpg,b.jpg,c.jpg

Angles are degrees about the point that the cameras look at. Azimuth 0 is the first training
view; it grows to the right of someone who stands there and looks at the scene. Uncovered is
1 - U_info where that is positive: 0 where a photograph was taken from, 1 where none informs.
One more photograph is advised where it leaves the least uncovered on average, among the places
that are uncovered at least half as much as the worst; nowhere where the cameras look outward.";

/// Show where the photographs of a scene leave holes, and where one more would help most
///
/// Nothing is trained and no GPU is needed.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct FieldArgs {
    /// Scene folder with images/ and sparse/0/, or `builtin[:WIDTH]` or `builtin:object[:WIDTH]`
    #[arg(long, value_name = "DIR", default_value = "builtin")]
    scene: SceneSource,

    /// Folder for field.json, field.svg (the potential and the virtual views) and gaps.svg
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Training views by name [default: split.json, or 4 views uniformly]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    train_views: Option<Vec<String>>,

    /// Change one config value; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
}

impl FieldArgs {
    pub(crate) fn run(self) -> Result<()> {
        let mut config = Config::preset(PRESETS[0].0)?;
        for setting in &self.settings {
            config = config
                .set(setting)
                .map_err(|e| e.at(format!("--set {setting}")))?;
        }
        config.validate()?;
        let scene = pipeline::load_scene(
            &self.scene.resolved()?,
            &LoadOptions {
                train_views: self.train_views,
                // They have no part in the field, and each would be decoded.
                n_test: 0,
                ..LoadOptions::new(&config)
            },
        )?;
        for warning in &scene.warnings {
            log::warn!("{warning}");
        }
        let maps = pipeline::field(&scene, &config)?;
        for warning in &maps.warnings {
            log::warn!("{warning}");
        }
        if let Some(out) = &self.out {
            create_dir(out)?;
            let json = serde_json::to_string_pretty(&maps.report)
                .map_err(|e| Error::new(e.to_string()).at_path(out))?;
            write_file(&out.join("field.json"), (json + "\n").as_bytes())?;
            write_file(&out.join("field.svg"), maps.potential_svg.as_bytes())?;
            write_file(&out.join("gaps.svg"), maps.gaps_svg.as_bytes())?;
            log::info!("wrote {}", out.display());
        }
        super::print(&text(&maps.report))
    }
}

/// Returns the lines that a person needs of a field.
fn text(report: &FieldReport) -> String {
    let columns = [
        Column::text("view", "view"),
        Column::number("azimuth_deg", "azimuth", 0),
        Column::number("elevation_deg", "elevation", 0),
        Column::number("u_info", "U_info", 2),
        Column::quantity("nearest", "nearest other"),
        Column::number("angle_deg", "angle", 0),
    ];
    let mut table = Table::new("training-views", &columns);
    for view in &report.training {
        table.row([
            (&view.name).into(),
            view.azimuth.into(),
            view.elevation.into(),
            view.u_info.into(),
            view.nearest.as_ref().map_or(Cell::Empty, Cell::from),
            view.nearest_angle.map_or(Cell::Empty, Cell::from),
        ]);
    }
    let gaps = &report.uncovered;
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    // Names come from files.
    let near = |nearest: &Option<String>| {
        let name = nearest.as_deref().unwrap_or_default();
        name.escape_debug().to_string()
    };
    let advised = match &report.advice {
        Some(advice) => format!(
            "One more photograph helps most at azimuth {:.0}, elevation {:.0}: it leaves {} uncovered.\n{}",
            advice.place.azimuth,
            advice.place.elevation,
            percent(advice.mean_uncovered),
            route(
                &near(&advice.place.nearest),
                advice.to_the_right,
                advice.upwards
            ),
        ),
        None => "The cameras look outward, so no place around the focus is advised for one more photograph."
            .to_owned(),
    };
    format!(
        "### {}\n\n{table}\n{}\n\
         At elevations from {:.0} to {:.0} degrees, {} is uncovered on average. The largest hole is at \
         azimuth {:.0}, elevation {:.0} ({} uncovered, {:.0} degrees from `{}`).\n\n{}\n",
        report.scene.escape_debug(),
        agreement_table(&report.agreement),
        gaps.elevations[0],
        gaps.elevations[1],
        percent(gaps.mean),
        gaps.worst.azimuth,
        gaps.worst.elevation,
        percent(gaps.worst_value),
        gaps.worst.nearest_angle.unwrap_or_default(),
        near(&gaps.worst.nearest),
        advised,
    )
}

/// Says how to walk from the nearest photograph to the advised one.
fn route(nearest: &str, to_the_right: f64, upwards: f64) -> String {
    let side = if to_the_right >= 0.0 { "right" } else { "left" };
    let height = match upwards {
        u if u >= 0.5 => format!(", {u:.0} degrees higher"),
        u if u <= -0.5 => format!(", {:.0} degrees lower", -u),
        _ => String::new(),
    };
    format!(
        "From where `{nearest}` was taken, facing the scene, walk {:.0} degrees around it to the \
         {side}{height}, and keep the distance.",
        to_the_right.abs()
    )
}
