//! What benches share: the options about a scene and a config, and cameras that are off.

#![allow(dead_code, reason = "every bench uses a part of it")]

use clap::Args;
use gspotential::camera::Camera;
use gspotential::config::Config;
use gspotential::error::Result;
use gspotential::pipeline::load_scene;
use gspotential::scene::{LoadOptions, Scene, SceneSource};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, UnitSphere};

/// What a bench is told of its config.
#[derive(Args)]
pub(crate) struct Settings {
    /// Change a config key; may be given again
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

impl Settings {
    /// `config` with the settings, checked.
    pub(crate) fn applied_to(&self, config: Config) -> Result<Config> {
        let set = |config: Config, setting: &String| config.set(setting);
        let config = self.settings.iter().try_fold(config, set)?;
        config.validate()?;
        Ok(config)
    }
}

/// What a bench on a scene is told.
#[derive(Args)]
pub(crate) struct SceneArgs {
    /// Scene: a folder, or builtin:WIDTH
    #[arg(long, default_value = "builtin")]
    scene: SceneSource,
    #[command(flatten)]
    settings: Settings,
}

impl SceneArgs {
    /// The preset with the settings, checked.
    pub(crate) fn config(&self, preset: &str) -> Result<Config> {
        self.settings.applied_to(Config::preset(preset)?)
    }

    /// The scene at `max_size` pixels or less on its longer side.
    pub(crate) fn load(&self, max_size: u32, options: LoadOptions) -> Result<Scene> {
        let source = self.scene.clone().resolved()?.at_most(max_size);
        let options = LoadOptions {
            max_size: Some(max_size),
            ..options
        };
        load_scene(&source, &options)
    }
}

/// `camera` turned about its centre by `turn` degrees and shifted by `shift`, each about or along an
/// axis drawn from `rng`.
pub(crate) fn put_off(camera: &Camera, turn: f64, shift: f64, rng: &mut ChaCha8Rng) -> Camera {
    let mut draw = |length: f64| -> [f64; 3] {
        let direction: [f64; 3] = UnitSphere.sample(rng);
        direction.map(|x| x * length)
    };
    let [a, b, c] = draw(turn.to_radians());
    let [x, y, z] = draw(shift);
    camera.moved([a, b, c, x, y, z])
}
