//! This module carries out what is planned; what is done already is taken as it is.

use std::path::PathBuf;

use super::plan::{Options, Variant};
use crate::config::Difference;
use crate::error::{Error, ErrorKind, Result};
use crate::eval::EvalOptions;
use crate::pipeline::{self, GoOn, TrainJob};
use crate::report::stats::Figure;
use crate::run::{Evaluation, Metrics, RunDir, SceneRecord};
use crate::version::VERSION;

/// A planned run.
pub(crate) struct Planned {
    /// Its directory's name.
    pub name: String,
    pub scene: String,
    pub variant: String,
    pub root: PathBuf,
    pub job: TrainJob,
}

/// The state of a planned run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No directory, or what an interruption left.
    ToTrain,
    /// Trained, but not measured as asked for.
    ToMeasure,
    /// Trained and measured as asked for.
    Done,
}

impl Planned {
    /// Plans one run for every seed.
    pub(crate) fn of(options: &Options, scene: &str, variant: &Variant) -> Vec<Planned> {
        let planned = |seed: &u64| {
            let name = format!("{scene}-{}-seed{seed}", variant.name);
            let mut job = variant.job.clone();
            job.config.seed = *seed;
            Planned {
                root: options.out.join("runs").join(&name),
                name,
                scene: scene.to_owned(),
                variant: variant.name.clone(),
                job,
            }
        };
        options.seeds.iter().map(planned).collect()
    }

    /// Tells how far the run is: not trained, not measured, or done.
    ///
    /// # Errors
    /// The directory holds something else: another config, scene, or version, or no run.
    pub(crate) fn state(&self, measure: &EvalOptions) -> Result<State> {
        if !self.root.join("config.json").exists() {
            RunDir::check(&self.root, false)?;
            return Ok(State::ToTrain);
        }
        let run = RunDir::open(&self.root)?;
        let another = |what: String| {
            Error::new(format!("holds another run: {what}"))
                .at_path(&self.root)
                .way_out("choose another --out, or remove the run")
        };
        let differences = run.config()?.departures(&self.job.config)?;
        if let Some(Difference { key, here, there }) = differences.first() {
            return Err(another(format!("its `{key}` is {here}, not {there}")));
        }
        if !self.root.join("metrics.json").exists() {
            return Ok(State::ToTrain);
        }
        let metrics = run.metrics()?;
        if let Some(what) = self.difference(&metrics) {
            return Err(another(what));
        }
        Ok(match pipeline::evaluation_at_hand(&run, measure)? {
            Some(_) => State::Done,
            None => State::ToMeasure,
        })
    }

    /// Says what of a finished run is not as planned.
    fn difference(&self, metrics: &Metrics) -> Option<String> {
        if metrics.version != VERSION {
            Some(format!("it is of version {}", metrics.version))
        } else if self.job.eval_every.is_some() && metrics.curve.is_empty() {
            Some("it has no curve".to_owned())
        } else {
            self.scene_difference(&metrics.scene)
        }
    }

    fn scene_difference(&self, there: &SceneRecord) -> Option<String> {
        let job = &self.job;
        let cloud = job.cloud.as_ref().map(ToString::to_string);
        let other = |names: &Option<Vec<String>>, there: &Vec<String>| {
            names.as_ref().is_some_and(|names| names != there)
        };
        if there.source != job.source.to_string() {
            Some(format!("its scene is {}", there.source))
        } else if there.cloud != cloud {
            let cloud = there.cloud.as_deref();
            Some(format!(
                "its cloud is {}",
                cloud.unwrap_or("the scene's own")
            ))
        } else if there.virtual_images != job.virtual_images {
            Some("its virtual views show other images".to_owned())
        } else if other(&job.train_views, &there.train_views) {
            Some("it has other training views".to_owned())
        } else if other(&job.test_views, &there.test_views) {
            Some("it has other test views".to_owned())
        } else {
            None
        }
    }

    /// Returns whether an interruption has left something of this run to go on from.
    fn is_begun(&self) -> bool {
        let begun = RunDir::open(&self.root).and_then(|run| run.job());
        begun.is_ok_and(|begun| {
            begun.eval_every == self.job.eval_every && self.scene_difference(&begun.scene).is_none()
        })
    }

    /// Does what is left to do, and reads what there is then.
    fn finish(&self, state: State, measure: &EvalOptions) -> Result<Finished> {
        match state {
            State::ToTrain if self.is_begun() => {
                TrainJob::resume(&self.root, GoOn::default(), measure)?;
            }
            State::ToTrain => {
                // Only what an interruption left is replaced.
                let overwrite = self.root.join("config.json").exists();
                self.job.run(&self.root, overwrite, measure)?;
            }
            State::ToMeasure => {
                pipeline::evaluate(&RunDir::open(&self.root)?, measure)?;
            }
            State::Done => {}
        }
        let run = RunDir::open(&self.root)?;
        Ok(Finished {
            metrics: run.metrics()?,
            evaluation: run.evaluation()?,
            scene: self.scene.clone(),
            variant: self.variant.clone(),
            job: self.job.clone(),
            run,
        })
    }
}

/// A run that is done.
#[derive(Clone)]
pub(crate) struct Finished {
    pub scene: String,
    pub variant: String,
    pub job: TrainJob,
    pub run: RunDir,
    pub metrics: Metrics,
    pub evaluation: Evaluation,
}

/// All that a study trained, in the order of the plan.
pub(crate) struct Results {
    pub runs: Vec<Finished>,
    /// How their test views were measured.
    pub measure: EvalOptions,
}

impl Results {
    /// Returns the scenes' names.
    pub(crate) fn scenes(&self) -> Vec<&str> {
        let mut scenes: Vec<&str> = self.runs.iter().map(|run| run.scene.as_str()).collect();
        scenes.dedup();
        scenes
    }

    /// Returns a variant's runs on a scene, in the order of the seeds; none where it lacks the
    /// variant.
    pub(crate) fn of(&self, scene: &str, variant: &str) -> Vec<&Finished> {
        let runs = self.runs.iter();
        runs.filter(|run| run.scene == scene && run.variant == variant)
            .collect()
    }

    /// Returns every scene and, where there are several, all together.
    pub(crate) fn scopes(&self) -> Vec<Scope<'_>> {
        self.scopes_among(self.scenes())
    }

    /// Does so first for the scenes none of whose runs `holds`, then for the others.
    pub(crate) fn scopes_by(&self, holds: impl Fn(&Finished) -> bool) -> Vec<Scope<'_>> {
        let is_other = |name: &&str| {
            let mut own = self.runs.iter().filter(|run| run.scene == *name);
            own.any(&holds)
        };
        let (others, first): (Vec<&str>, Vec<&str>) = self.scenes().into_iter().partition(is_other);
        let mut scopes = self.scopes_among(first);
        scopes.extend(self.scopes_among(others));
        scopes
    }

    fn scopes_among(&self, scenes: Vec<&str>) -> Vec<Scope<'_>> {
        let scope = |name: String, scenes: Vec<&'_ str>| Scope {
            name,
            scenes: scenes.into_iter().map(str::to_owned).collect(),
            results: self,
        };
        let one = scenes
            .iter()
            .map(|name| scope((*name).to_owned(), vec![name]));
        let mut scopes: Vec<Scope> = one.collect();
        if scenes.len() > 1 {
            scopes.push(scope(format!("mean of {}", scenes.len()), scenes));
        }
        scopes
    }
}

/// Runs on a scene, or on several that are averaged.
pub(crate) struct Scope<'a> {
    pub name: String,
    scenes: Vec<String>,
    results: &'a Results,
}

impl Scope<'_> {
    /// Returns whether every scene has the variant.
    pub(crate) fn has(&self, variant: &str) -> bool {
        let mut scenes = self.scenes.iter();
        scenes.all(|scene| !self.results.of(scene, variant).is_empty())
    }

    /// Returns what the variant's runs measured: the mean over the scenes of every seed, and how
    /// far the seeds spread. `None` where a run has no value.
    pub(crate) fn figure(
        &self,
        variant: &str,
        measure: impl Fn(&Finished) -> Option<f64>,
    ) -> Option<Figure> {
        let runs = self
            .scenes
            .iter()
            .map(|scene| self.results.of(scene, variant));
        let runs: Vec<Vec<&Finished>> = runs.collect();
        let n_seeds = runs.iter().map(Vec::len).min()?;
        let of_seed = |i: usize| Some(Figure::of(runs.iter().map(|runs| measure(runs[i])))?.mean);
        Figure::of((0..n_seeds).map(of_seed))
    }
}

/// Has every run done. A run that fails does not keep those after it from being done.
///
/// # Errors
/// Before anything is trained: a directory that holds another run. After all that can be is
/// done: runs that failed. A stop that was asked for.
pub(crate) fn carry_out(plan: &[Planned], measure: &EvalOptions) -> Result<Results> {
    let states = plan
        .iter()
        .map(|planned| planned.state(measure))
        .collect::<Result<Vec<State>>>()?;
    let n_done = states.iter().filter(|state| **state == State::Done).count();
    log::info!("{} runs, {n_done} of them done already", plan.len());
    let mut runs = Vec::new();
    let mut failures = Vec::new();
    for (i, (planned, state)) in plan.iter().zip(states).enumerate() {
        if state != State::Done {
            log::info!("run {} of {}: {}", i + 1, plan.len(), planned.name);
        }
        match planned.finish(state, measure) {
            Ok(run) => runs.push(run),
            Err(e) if e.kind() == ErrorKind::Interrupted => {
                let e = e.at(format!("run {}", planned.name));
                return Err(e.way_out("the same command goes on there"));
            }
            Err(e) => {
                log::warn!("run {} failed: {e}", planned.name);
                failures.push((planned, e));
            }
        }
    }
    match failures.first() {
        None => Ok(Results {
            runs,
            measure: measure.clone(),
        }),
        Some((planned, e)) => Err(Error::new(format!(
            "{} of {} runs failed; the first: {}: {e}",
            failures.len(),
            plan.len(),
            planned.name
        ))
        .way_out("the others are kept, and the same command tries these again")),
    }
}
