//! The studies make the paper's tables and figures: each is a list of runs and a fold of what they
//! measured into tables and plots.
//!
//! A run that is done already, with the same config and scene, is not trained again.

mod ablation;
mod ceiling;
mod cloud;
mod errors;
mod front;
mod kernel;
mod need;
mod output;
mod parameters;
mod parts;
mod pilot;
mod plan;
mod potential;
mod presets;
mod quality;
mod renders;
mod runs;
mod sampling;
mod systems;
mod viewpoints;
mod views;
mod whereabouts;

pub use front::{Place, below, front};
pub use plan::Options;
pub use runs::State;
pub use views::spread_order;

use plan::{Base, Variant, check_names};
use renders::Method;
use runs::{Planned, Results, carry_out};

use crate::error::{Error, Result};
use crate::pipeline;
use crate::report::Table;
use crate::run::RunDir;

/// The studies that there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum StudyName {
    /// What each part of the method adds (Table 2)
    Ablation,
    /// Clouds from few and many views, thinned and random points (Table 3, Figure 6)
    Cloud,
    /// Ways to choose the virtual views (Table 4)
    Sampling,
    /// 3 to 9 training views (Table 5)
    Views,
    /// PSNR over the view sphere with one camera and with all (the pilot study)
    Pilot,
    /// Kernels of the field: does their potential rank viewpoints by quality? (Figures 4 and 5)
    Kernel,
    /// Sigma and lambda of the field: potential against quality, and lambda trained with
    Parameters,
    /// The field on the sphere, and what predicts the quality of a test view
    Potential,
    /// What the parts beyond the paper add, one by one and together
    Parts,
    /// The presets side by side, over iterations and over seconds
    Presets,
    /// Whole systems on scenes and objects: quality, seconds, Gaussians (Table 1)
    Systems,
    /// What quality costs: SH degree, Gaussians, virtual views, iterations, resolution
    Need,
    /// What is left to gain beside training on all photographs and from an exact cloud, and where
    /// the error lies
    Ceiling,
}

impl StudyName {
    /// Returns the name as the command line takes it, which also names the report's files.
    pub fn name(self) -> &'static str {
        match self {
            StudyName::Ablation => "ablation",
            StudyName::Cloud => "cloud",
            StudyName::Sampling => "sampling",
            StudyName::Views => "views",
            StudyName::Pilot => "pilot",
            StudyName::Kernel => "kernel",
            StudyName::Parameters => "parameters",
            StudyName::Potential => "potential",
            StudyName::Parts => "parts",
            StudyName::Presets => "presets",
            StudyName::Systems => "systems",
            StudyName::Need => "need",
            StudyName::Ceiling => "ceiling",
        }
    }

    fn study(self) -> &'static dyn Study {
        match self {
            StudyName::Ablation => &ablation::Ablation,
            StudyName::Cloud => &cloud::Cloud,
            StudyName::Sampling => &sampling::Sampling,
            StudyName::Views => &views::Views,
            StudyName::Pilot => &pilot::Pilot,
            StudyName::Kernel => &kernel::KernelStudy,
            StudyName::Parameters => &parameters::Parameters,
            StudyName::Potential => &potential::Potential,
            StudyName::Parts => &parts::Parts,
            StudyName::Presets => &presets::Presets,
            StudyName::Systems => &systems::Systems,
            StudyName::Need => &need::Need,
            StudyName::Ceiling => &ceiling::Ceiling,
        }
    }
}

/// A study: its question, the runs that it needs and its report.
trait Study {
    /// Says in one sentence, for the head of the report, what is compared.
    fn question(&self) -> &'static str;

    /// Lists the variants to train of one scene.
    fn variants(&self, base: &Base) -> Result<Vec<Variant>>;

    /// Makes tables and pictures of what they measured.
    fn report(&self, results: &Results) -> Result<Report>;

    /// Lists the methods whose renders are shown side by side; none if the study is about one.
    fn methods(&self, _results: &Results) -> Vec<Method> {
        Vec::new()
    }
}

/// The report of a study.
#[derive(Default)]
struct Report {
    tables: Vec<Table>,
    pictures: Vec<Picture>,
    /// What a reader must know, beyond what every study says; a sentence each.
    notes: Vec<String>,
}

struct Picture {
    /// Name of its file.
    name: String,
    svg: String,
}

/// Trains what is left to train for a study and writes its report; returns it as Markdown.
///
/// # Errors
/// Usage, before anything is trained: options that a config does not allow. A run directory that
/// holds another run. Runs that failed, after the others are done.
pub fn run(name: StudyName, options: &Options) -> Result<String> {
    let study = name.study();
    let plan = plan(study, options)?;
    check_test_views(options, &plan)?;
    let results = carry_out(&plan, &options.measure)?;
    let report = study.report(&results)?;
    let methods = study.methods(&results);
    // The pictures below need the scenes, which a study that is done does not.
    let renders = match methods.is_empty() {
        true => None,
        false => renders::grid(&results, &methods)
            .inspect_err(|e| log::warn!("{}-renders.png is not made: {e}", name.name()))
            .ok(),
    };
    let shown = (&report, renders.as_ref());
    let text = output::write(name, study.question(), options, &results, shown)?;
    let runs: Vec<&RunDir> = results.runs.iter().map(|finished| &finished.run).collect();
    let page = options.out.join(format!("{}.html", name.name()));
    if let Err(e) = pipeline::compare(&runs, &page) {
        log::warn!("{} is not written: {e}", page.display());
    }
    Ok(text)
}

/// A run of a study and what there is of it.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Its name.
    pub run: String,
    /// What there is of it.
    pub state: State,
}

/// Lists the runs of a study with what there is of each.
///
/// # Errors
/// As those of [`run`] before training.
pub fn list(name: StudyName, options: &Options) -> Result<Vec<Listed>> {
    let plan = plan(name.study(), options)?;
    let listed = |planned: &Planned| {
        Ok(Listed {
            run: planned.name.clone(),
            state: planned.state(&options.measure)?,
        })
    };
    plan.iter().map(listed).collect()
}

fn plan(study: &dyn Study, options: &Options) -> Result<Vec<Planned>> {
    if let Some(seed) = repeated(&options.seeds) {
        return Err(Error::usage(format!("--seeds names {seed} twice")));
    }
    let bases = options.scenes.iter().map(|scene| Base::new(options, scene));
    let bases = bases.collect::<Result<Vec<Base>>>()?;
    check_names(&bases)?;
    let mut plan = Vec::new();
    for base in &bases {
        for variant in study.variants(base)? {
            plan.extend(Planned::of(options, &base.name(), &variant));
        }
    }
    Ok(plan)
}

/// Refuses scenes without test views before anything is trained on them: a study compares renders of test
/// views with their photographs.
fn check_test_views(options: &Options, plan: &[Planned]) -> Result<()> {
    for source in &options.scenes {
        let base = Base::new(options, source)?;
        let to_train = |p: &Planned| {
            Ok(p.scene == base.name() && p.state(&options.measure)? == State::ToTrain)
        };
        let states = plan.iter().map(to_train).collect::<Result<Vec<bool>>>()?;
        if states.contains(&true) && base.scene()?.test.is_empty() {
            return Err(Error::usage(format!("scene `{}` has no test views", base.name())).way_out(
                "a study measures at test views: name some under `test` in the scene's split.json",
            ));
        }
    }
    Ok(())
}

fn repeated(seeds: &[u64]) -> Option<u64> {
    let again = |(i, seed): (usize, &u64)| seeds[..i].contains(seed).then_some(*seed);
    seeds.iter().enumerate().find_map(again)
}

/// Returns words joined to a file's name, with `-` in place of what may not stand in a link.
fn file_name(words: &[&str]) -> String {
    let plain = |c: char| {
        if c.is_alphanumeric() || c == '_' {
            c
        } else {
            '-'
        }
    };
    words.join("-").chars().map(plain).collect()
}
