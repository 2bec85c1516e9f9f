//! What refining poses gives back: a scene's training cameras are put off by a known motion, trained
//! with and without refinement, and held against the true ones.
//!
//! `cargo bench --bench poses -- [--scene DIR|builtin:WIDTH] [--max-size PX] [--turn DEG]
//! [--shift SHARE] [--set KEY=VALUE]...`
//!
//! Cloud and test views keep the scene's own poses, so that errors need no alignment.

mod kit;

use clap::Parser;
use gspotential::camera::{Camera, Frame};
use gspotential::config::Config;
use gspotential::error::Result;
use gspotential::eval::PoseErrors;
use gspotential::field::Focus;
use gspotential::gpu::Gpu;
use gspotential::pipeline::prepare;
use gspotential::render::{Device, Kernels};
use gspotential::report::{Cell, Column, Table};
use gspotential::run::Seconds;
use gspotential::scene::{LoadOptions, Scene};
use gspotential::train::train;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use kit::{SceneArgs, mean_scores};

const COLUMNS: [Column; 7] = [
    Column::text("poses", "poses"),
    Column::text("refined", "refined"),
    Column::number("turn_deg", "turn, degrees", 2),
    Column::number("shift", "shift, % of R", 2),
    Column::number("pixels", "pixels", 2),
    Column::number("psnr", "PSNR dB", 2),
    Column::number("ssim", "SSIM", 3),
];

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long, default_value_t = 160)]
    max_size: u32,
    #[arg(long, default_value = "paper")]
    preset: String,
    /// Turn of every training camera about its centre, degrees
    #[arg(long, default_value_t = 1.0)]
    turn: f64,
    /// Shift of its centre, as a share of the sphere's radius
    #[arg(long, default_value_t = 0.01)]
    shift: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut config = args.on.config(&args.preset)?;
    config.scene.max_size_px = Some(args.max_size);
    let scene = args.on.load(args.max_size, LoadOptions::new(&config))?;
    let truth: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
    let frame = Focus::find(&truth, &scene.cloud)?.frame();
    let off = put_off(&scene, &frame, &args, config.seed);
    let mut table = Table::new("poses", &COLUMNS);
    let all = [
        ("true", &scene, false),
        ("off", &off, false),
        ("true", &scene, true),
        ("off", &off, true),
    ];
    for (poses, scene, refine) in all {
        config.poses.refine = refine;
        let figures = trained(scene, &config, (&truth, &frame))?;
        let head: [Cell; 2] = [poses.into(), if refine { "yes" } else { "no" }.into()];
        table.row(head.into_iter().chain(figures));
    }
    print!("{table}");
    Ok(())
}

/// The scene with every training camera turned and shifted into directions drawn from the seed.
fn put_off(scene: &Scene, frame: &Frame, args: &Args, seed: u64) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut scene = scene.clone();
    for view in &mut scene.train {
        let shift = args.shift * frame.radius;
        view.camera = kit::put_off(&view.camera, args.turn, shift, &mut rng);
    }
    scene
}

/// Trains and returns cells of the table.
fn trained(
    scene: &Scene,
    config: &Config,
    (truth, frame): (&[Camera], &Frame),
) -> Result<[Cell; 5]> {
    let prepared = prepare(scene, config, &mut Seconds::default())?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = train(&gpu, &kernels, start, supervision, config, &mut ())?;
    let to_world = |camera: &Camera| prepared.frame.camera_to_world(camera);
    let cameras: Vec<Camera> = trained.cameras.iter().map(to_world).collect();
    let errors = PoseErrors::of(&cameras, truth, &scene.cloud, frame);
    let device = Device {
        gpu: &gpu,
        kernels: &kernels,
    };
    let frame = &prepared.frame;
    let [psnr, ssim] = mean_scores(device, &trained.gaussians, frame, &scene.test, config)?;
    let figures = [
        errors.turn_deg,
        100.0 * errors.shift,
        errors.pixels,
        psnr,
        ssim,
    ];
    Ok(figures.map(Cell::from))
}
