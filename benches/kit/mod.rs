//! What benches share: options about a scene, a config and a size, cameras that are off, scores of
//! what was trained, and processor time.

#![allow(dead_code, reason = "every bench uses a part of it")]

use std::str::FromStr;

use clap::Args;
use gspotential::camera::{Camera, Frame};
use gspotential::config::Config;
use gspotential::error::{Error, Result};
use gspotential::eval::{EvalOptions, render_views, score};
use gspotential::gaussians::Gaussians;
use gspotential::pipeline::load_scene;
use gspotential::render::Device;
use gspotential::scene::{LoadOptions, Scene, SceneSource, View};
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

/// Means of PSNR (dB) and SSIM of Gaussians at `views`.
pub(crate) fn mean_scores(
    device: Device<'_>,
    gaussians: &Gaussians,
    frame: &Frame,
    views: &[View],
    config: &Config,
) -> Result<[f64; 2]> {
    let (mut psnr, mut ssim) = (0.0, 0.0);
    let options = EvalOptions::default();
    let look = |view: &View, rendered: &_| {
        let score = score(rendered, view, None, &options)?;
        psnr += score.psnr.unwrap_or(f64::NAN);
        ssim += score.ssim.unwrap_or(f64::NAN);
        Ok(())
    };
    render_views(device, gaussians, frame, views, &config.model, look)?;
    Ok([psnr, ssim].map(|sum| sum / views.len() as f64))
}

/// Width and height, given as `320x213`.
#[derive(Clone, Copy)]
pub(crate) struct Size {
    pub pixels: (u32, u32),
}

impl FromStr for Size {
    type Err = Error;

    fn from_str(text: &str) -> Result<Size> {
        let sides = text.split_once('x');
        let pixels = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let no_size = || Error::usage(format!("`{text}` is not a size")).way_out("write 320x213");
        Ok(Size {
            pixels: pixels.ok_or_else(no_size)?,
        })
    }
}

/// User and system time of this process, where the system tells (Linux, in ticks of 10 ms).
pub(crate) fn cpu_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in brackets may hold spaces; what follows it does not.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Processor time of this thread alone, where the system tells (Linux, in nanoseconds).
pub(crate) fn thread_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let ns: f64 = stat.split_whitespace().next()?.parse().ok()?;
    Some(1e-9 * ns)
}
