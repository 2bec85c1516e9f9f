//! Measures where each strategy puts its virtual views, what they show of the cloud, and what choosing them
//! takes.
//!
//! `cargo bench --bench views -- [--scene DIR|builtin:WIDTH] [--max-size PX] [--set KEY=VALUE]...`
//!
//! First the estimate that candidates are chosen by is held against the cloud at full size.

mod kit;

use std::time::Instant;

use clap::Parser;
use gspotential::camera::Camera;
use gspotential::cloud::visibility::{Support, Visibility, candidate_shares};
use gspotential::error::Result;
use gspotential::field::{Field, Focus};
use gspotential::report::{Column, Table};
use gspotential::scene::LoadOptions;
use gspotential::views::{VirtualView, candidates, virtual_views};

use kit::SceneArgs;

/// Every so many candidates are measured in full.
const STRIDE: usize = 16;

const COLUMNS: [Column; 7] = [
    Column::text("strategy", "strategy"),
    Column::number("views", "views", 0),
    Column::number("below_horizon", "% below horizon", 0),
    Column::number("far", "% beyond 60 degrees", 0),
    Column::number("coverage", "% covered", 0),
    Column::number("visible", "% visible", 0),
    Column::number("s", "s", 3),
];

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long, default_value_t = 320)]
    max_size: u32,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let config = args.on.config("paper")?;
    let options = LoadOptions {
        n_test: 1,
        ..LoadOptions::new(&config)
    };
    let scene = args.on.load(args.max_size, options)?;
    let train: Vec<Camera> = scene.train.iter().map(|v| v.camera.clone()).collect();
    let focus = Focus::find(&train, &scene.cloud)?;
    let field = Field::new(&train, &focus, &config.field);
    let frame = focus.frame();
    let (near, visibility) = (config.model.near, &config.views.visibility);
    let whole = Visibility::new(&scene.cloud, &scene.cloud, &frame, &train, visibility, near)?;
    let measure = |views: &[VirtualView]| -> Result<Vec<Support>> {
        let cameras: Vec<Camera> = views.iter().map(|v| v.camera.clone()).collect();
        whole.measure(&cameras, &config.splat)
    };

    let candidates = candidates(&train, &focus, &field, &config)?;
    let cameras: Vec<Camera> = candidates.iter().map(|v| v.camera.clone()).collect();
    let start = Instant::now();
    let shares = candidate_shares(&cameras, &scene.cloud, &frame, &train, &config)?;
    let n = cameras.len();
    println!(
        "{}: {} points, {n} candidates judged in {:.2} s",
        scene.name,
        scene.cloud.len(),
        start.elapsed().as_secs_f64()
    );
    let sample: Vec<VirtualView> = candidates.into_iter().step_by(STRIDE).collect();
    let full = measure(&sample)?;
    let errors: Vec<f64> = full
        .iter()
        .zip(shares.iter().step_by(STRIDE))
        .map(|(full, share)| share - full.visible_share)
        .collect();
    let n = errors.len() as f64;
    println!(
        "estimate less full size, {n} candidates: mean {:+.4}, mean absolute {:.4}, greatest {:.4}\n",
        errors.iter().sum::<f64>() / n,
        errors.iter().map(|e| e.abs()).sum::<f64>() / n,
        errors.iter().fold(0.0, |most: f64, e| most.max(e.abs()))
    );

    let mut table = Table::new("views", &COLUMNS);
    let up = train.iter().map(Camera::up).sum();
    for (name, weighed) in [
        ("potential", false),
        ("nearest_angle", false),
        ("sphere_uniform", false),
        ("sphere_farthest", false),
        ("interpolation", false),
        ("potential", true),
        ("nearest_angle", true),
        ("sphere_uniform", true),
        ("sphere_farthest", true),
    ] {
        let config = config.set(&format!("views.strategy={name}"))?;
        let shares = weighed.then_some(shares.as_slice());
        let start = Instant::now();
        let views = virtual_views(&train, &focus, &field, shares, &config)?;
        let seconds = start.elapsed().as_secs_f64();
        let supports = measure(&views)?;
        let share = |f: &dyn Fn(usize) -> f64| {
            100.0 * (0..views.len()).map(f).sum::<f64>() / views.len() as f64
        };
        table.row([
            format!("{name}{}", if weighed { " + visibility" } else { "" }).into(),
            views.len().into(),
            share(&|k| f64::from(views[k].direction.dot(up) < 0.0)).into(),
            share(&|k| f64::from(views[k].u_conf.to_degrees() > 60.0)).into(),
            share(&|k| supports[k].coverage).into(),
            share(&|k| supports[k].visible_share).into(),
            seconds.into(),
        ]);
    }
    print!("{table}");
    Ok(())
}
