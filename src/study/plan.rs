//! This module plans what a study trains: variants of a job, on every scene, with every seed.

use std::path::PathBuf;

use crate::config::{Config, Difference};
use crate::error::{Error, Result};
use crate::eval::EvalOptions;
use crate::pipeline::TrainJob;
use crate::scene::{Scene, SceneSource};

/// Options that all runs of a study share.
#[derive(Clone, Debug)]
pub struct Options {
    /// Every variant is trained on each.
    pub scenes: Vec<SceneSource>,
    /// Run directories go to its `runs/`, which studies with the same options may share.
    pub out: PathBuf,
    /// One run of each variant for every seed.
    pub seeds: Vec<u64>,
    /// Most iterations of a run; `None`: as its preset has them.
    pub iterations: Option<u32>,
    /// Longest image side, pixels; `None`: as the preset has it.
    pub max_size: Option<u32>,
    /// Points that training starts from at most; `None`: as the preset has it.
    pub max_points: Option<usize>,
    /// `key=value` for every run. They change what the presets share; what makes a preset or a
    /// variant what it is stays.
    pub settings: Vec<String>,
    /// How test views are measured.
    pub measure: EvalOptions,
}

/// One way to train a scene, the seed aside.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Variant {
    /// Part of its run directories' names, between the scene's name and the seed. Jobs
    /// of one name are the same job whatever the study.
    pub name: String,
    pub job: TrainJob,
}

/// Makes a scene's variants.
pub(crate) struct Base<'a> {
    options: &'a Options,
    source: SceneSource,
}

impl<'a> Base<'a> {
    /// Starts from a scene, whose folder must be there.
    ///
    /// # Errors
    /// A folder that is not there.
    pub(crate) fn new(options: &'a Options, source: &SceneSource) -> Result<Base<'a>> {
        Ok(Base {
            options,
            source: source.clone().resolved()?,
        })
    }

    /// Returns the short name of the scene for tables and folders.
    pub(crate) fn name(&self) -> String {
        self.source.name()
    }

    pub(crate) fn source(&self) -> &SceneSource {
        &self.source
    }

    /// Returns the least shorter side of a test view, pixels, with which all that is asked for can
    /// be measured.
    pub(crate) fn min_side_px(&self) -> u32 {
        let lpips = self.options.measure.lpips.as_ref();
        lpips.map_or(1, |lpips| lpips.min_side_px())
    }

    /// Makes the config: the method under the study's options, then what the preset does otherwise
    /// than the method, then `changes` (`key=value`). A preset that trains for fewer iterations than are stated keeps them;
    /// one that would train for more has its late stages as much sooner, where it would end before them.
    ///
    /// # Errors
    /// Usage: what the config does not allow.
    pub(crate) fn config(&self, preset: &str, changes: &[String]) -> Result<Config> {
        let options = self.options;
        let method = Config::preset("paper")?;
        let preset = Config::preset(preset)?;
        let mut config = method.clone();
        for setting in &options.settings {
            config = config
                .set(setting)
                .map_err(|e| e.at(format!("--set {setting}")))?;
        }
        let set = Some(config.iterations).filter(|set| *set != method.iterations);
        let own_iterations = preset.iterations;
        let most = options.iterations.or(set).unwrap_or(own_iterations);
        config.iterations = most.min(own_iterations);
        config.scene.max_size_px = options.max_size.or(config.scene.max_size_px);
        config.scene.max_points = options.max_points.or(config.scene.max_points);
        let own = preset.differences(&method)?;
        let own = own
            .iter()
            .filter(|difference| difference.key != "iterations")
            .map(Difference::setting);
        // Iterations that are stated are not chosen.
        let stated = options.iterations.map(|_| "need.ends=false".to_owned());
        for change in own.chain(stated) {
            config = config.set(&change)?;
        }
        let is_stated = |key: &str| options.settings.iter().any(|set| set.starts_with(key));
        let sooner = in_time(&config, own_iterations);
        let sooner = sooner
            .into_iter()
            .filter(|change| !is_stated(key_of(change)));
        for change in sooner.chain(changes.iter().cloned()) {
            config = config.set(&change)?;
        }
        config.preset = preset.preset;
        config.validate()?;
        Ok(config)
    }

    /// Makes the variant `name`: a preset with changes, on the scene's own split and cloud.
    ///
    /// # Errors
    /// As [`Base::config`].
    pub(crate) fn variant(&self, name: &str, preset: &str, changes: &[String]) -> Result<Variant> {
        Ok(Variant {
            name: name.to_owned(),
            job: TrainJob::new(self.source.clone(), self.config(preset, changes)?)?,
        })
    }

    /// Makes the presets' own variants.
    ///
    /// # Errors
    /// As [`Base::config`].
    pub(crate) fn presets(&self, names: &[&str]) -> Result<Vec<Variant>> {
        let variants = names.iter().map(|name| self.variant(name, name, &[]));
        variants.collect()
    }

    /// Loads the scene as the method's preset does, for variants that depend on what it has.
    ///
    /// # Errors
    /// What loading refuses.
    pub(crate) fn scene(&self) -> Result<Scene> {
        let variant = self.variant("paper", "paper", &[])?;
        variant.job.load()
    }
}

/// Returns the settings with which late stages of a preset, made for `own` iterations, begin as much sooner as the
/// run is shorter; those that it reaches stay.
fn in_time(config: &Config, own: u32) -> Vec<String> {
    let is_guided = config.coverage.prune || config.coverage.densify;
    let stages = [
        ("coverage.start", is_guided.then_some(config.coverage.start)),
        ("floaters.after", config.floaters.after),
    ];
    let late =
        |after: u32| (after >= config.iterations && config.iterations < own).then_some(after);
    let sooner = |after: u32| u64::from(after) * u64::from(config.iterations) / u64::from(own);
    let of = |(key, after): (&str, Option<u32>)| {
        let after = sooner(after.and_then(late)?);
        Some(format!("{key}={after}"))
    };
    stages.into_iter().filter_map(of).collect()
}

/// Returns what a setting sets, with the sign of equality.
fn key_of(setting: &str) -> &str {
    setting.find('=').map_or(setting, |at| &setting[..=at])
}

/// Refuses two scenes of one name, which would share their run directories.
pub(crate) fn check_names(bases: &[Base]) -> Result<()> {
    for (i, base) in bases.iter().enumerate() {
        if bases[..i].iter().any(|other| other.name() == base.name()) {
            return Err(
                Error::usage(format!("two scenes are named `{}`", base.name()))
                    .way_out("name each once, and rename one of two folders of the same name"),
            );
        }
    }
    Ok(())
}
