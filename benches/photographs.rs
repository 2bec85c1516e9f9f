//! What becomes of photographs whose cameras and depths are a little off, as those that a network
//! finds are: its place is taken by exact ones with stated errors.
//!
//! `cargo bench --bench photographs -- [--scene DIR|builtin:WIDTH] [--seeds 0,1,2] [--turn DEG]
//! [--shift SHARE] [--scale SHARE] [--max-size PX] [--train] [--set KEY=VALUE]...`
//!
//! Depths are traced in the built-in scene, else the scene's cloud is projected into its views. Each view
//! is turned and shifted into a direction of its own, and its depths are scaled. *Apart* is how far a pixel
//! of one view lies in another from where it should, the median of all pairs: it needs no
//! alignment. With `--train`, scenes are trained from either, and test cameras brought into their frame by a
//! similarity and fitted to their photographs.

mod kit;

use clap::Parser;
use gspotential::camera::{Camera, Frame, Similarity};
use gspotential::config::Config;
use gspotential::dense::{Adjusted, CloudOptions, DepthMap, adjust, cloud};
use gspotential::error::Result;
use gspotential::eval::fit_poses;
use gspotential::gpu::Gpu;
use gspotential::pipeline::{focus_of, prepare};
use gspotential::render::{Device, Kernels};
use gspotential::report::{Cell, Column, Table};
use gspotential::run::Seconds;
use gspotential::scene::builtin::trace;
use gspotential::scene::{LoadOptions, Scene, View};
use gspotential::train::train;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use kit::{SceneArgs, mean_scores};

const COLUMNS: [Column; 10] = [
    Column::text("seed", "seed"),
    Column::text("cameras", "cameras"),
    Column::text("adjusted", "adjusted"),
    Column::text("residual", "residual"),
    Column::text("kept", "kept"),
    Column::number("apart_px", "apart, px", 3),
    Column::number("turned_deg", "turned by, degrees", 3),
    Column::text("refined", "refined"),
    Column::number("psnr", "PSNR dB", 2),
    Column::number("ssim", "SSIM", 3),
];

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long, default_value_t = 160)]
    max_size: u32,
    #[arg(long, value_delimiter = ',', default_value = "0,1,2")]
    seeds: Vec<u64>,
    /// Turn of every camera about its centre, degrees
    #[arg(long, default_value_t = 1.0)]
    turn: f64,
    /// Shift of its centre, as a share of the sphere's radius
    #[arg(long, default_value_t = 0.01)]
    shift: f64,
    /// Share by which its depths are scaled up or down
    #[arg(long, default_value_t = 0.03)]
    scale: f64,
    /// Train from all of them, too
    #[arg(long)]
    train: bool,
    /// Test views that are measured, evenly of the scene's
    #[arg(long, default_value_t = 8)]
    test_views: usize,
    #[arg(long, default_value_t = 700)]
    iterations: u32,
    #[arg(long, default_value_t = 9000)]
    max_points: usize,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut config = args.on.config("gspotential")?;
    config.scene.max_size_px = Some(args.max_size);
    config.scene.max_points = Some(args.max_points);
    config.iterations = args.iterations;
    config.validate()?;
    let mut scene = args.on.load(args.max_size, LoadOptions::new(&config))?;
    let step = scene.test.len().div_ceil(args.test_views.max(1)).max(1);
    scene.test = scene.test.into_iter().step_by(step).collect();
    let (_, frame) = focus_of(&scene)?;
    let exact = maps(&scene, scene.name == "builtin");
    let mut table = Table::new("photographs", &COLUMNS);
    for seed in &args.seeds {
        config.seed = *seed;
        let off = put_off(&exact, &frame, &args, *seed);
        for (name, maps) in [("exact", &exact), ("off", &off)] {
            let adjusted = adjust(maps);
            let as_is = Adjusted {
                maps: maps.clone(),
                kept: false,
                ..adjusted.clone()
            };
            for (way, is_adjusted) in [(&as_is, false), (&adjusted, true)] {
                for refine in [false, true] {
                    config.poses.refine = refine;
                    // Both ways are one if nothing was kept.
                    let is_told = is_adjusted && !way.kept;
                    if refine && (!args.train || name == "exact") {
                        continue;
                    }
                    let measured = match args.train && !is_told {
                        true => trained(&scene, &way.maps, &config)?,
                        false => [Cell::Empty, Cell::Empty],
                    };
                    let turned = maps.iter().zip(&way.maps);
                    let turned = turned.map(|(a, b)| a.camera.difference(&b.camera).turn);
                    let row: [Cell; 8] = [
                        seed.to_string().into(),
                        name.into(),
                        yes(is_adjusted).into(),
                        format!("{:.4} to {:.4}", adjusted.residual[0], adjusted.residual[1])
                            .into(),
                        if is_adjusted { yes(way.kept) } else { "" }.into(),
                        apart(&way.maps, &exact).into(),
                        turned.fold(0.0, f64::max).to_degrees().into(),
                        yes(refine).into(),
                    ];
                    table.row(row.into_iter().chain(measured));
                }
            }
        }
    }
    print!("{table}");
    Ok(())
}

fn yes(is: bool) -> &'static str {
    if is { "yes" } else { "no" }
}

/// What a network without errors would find of the training views.
fn maps(scene: &Scene, is_builtin: bool) -> Vec<DepthMap> {
    let map = |View { camera, image, .. }: &View| {
        let depth: Vec<f32> = match is_builtin {
            true => trace(camera).depth.iter().map(|d| *d as f32).collect(),
            false => projected(scene, camera),
        };
        DepthMap {
            camera: camera.clone(),
            confidence: vec![1.0; depth.len()],
            depth,
            colors: image.rgb.as_chunks().0.to_vec(),
        }
    };
    scene.train.iter().map(map).collect()
}

/// The depth of the nearest point in every pixel; 0 where there is none.
fn projected(scene: &Scene, camera: &Camera) -> Vec<f32> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut depth = vec![0.0_f32; width * height];
    for point in &scene.cloud.positions {
        let (place, z) = camera.project(*point);
        let inside = place.x >= 0.0 && place.y >= 0.0 && z > 0.0;
        let (x, y) = (place.x as usize, place.y as usize);
        if inside && x < width && y < height {
            let stored = &mut depth[y * width + x];
            if *stored == 0.0 || (z as f32) < *stored {
                *stored = z as f32;
            }
        }
    }
    depth
}

/// Cameras turned and shifted into directions drawn from the seed, depths scaled up or down.
fn put_off(maps: &[DepthMap], frame: &Frame, args: &Args, seed: u64) -> Vec<DepthMap> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut off = maps.to_vec();
    for map in &mut off {
        let shift = args.shift * frame.radius;
        map.camera = kit::put_off(&map.camera, args.turn, shift, &mut rng);
        let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
        let scale = (1.0 + sign * args.scale) as f32;
        map.depth.iter_mut().for_each(|depth| *depth *= scale);
    }
    off
}

/// Median distance between where a view's pixels lie in the other views and where they should.
fn apart(maps: &[DepthMap], exact: &[DepthMap]) -> f64 {
    let mut distances = Vec::new();
    for (i, (ours, truth)) in maps.iter().zip(exact).enumerate() {
        for (_, (other, other_truth)) in maps.iter().zip(exact).enumerate().filter(|(j, _)| *j != i)
        {
            let width = truth.camera.width as usize;
            for at in 0..truth.depth.len() {
                let (x, y) = (at % width, at / width);
                let (Some(depth), Some(right)) = (ours.at(x, y), truth.at(x, y)) else {
                    continue;
                };
                let (should, z) = other_truth.camera.project(truth.point(x, y, right));
                if z > 0.0 && other_truth.pixel(should).is_some() {
                    let (is, _) = other.camera.project(ours.point(x, y, depth));
                    distances.push(is.distance(should));
                }
            }
        }
    }
    let middle = distances.len() / 2;
    match distances.is_empty() {
        true => f64::NAN,
        false => *distances.select_nth_unstable_by(middle, f64::total_cmp).1,
    }
}

/// Trains from the maps and returns PSNR and SSIM.
fn trained(scene: &Scene, maps: &[DepthMap], config: &Config) -> Result<[Cell; 2]> {
    let centers =
        |cameras: &mut dyn Iterator<Item = &Camera>| cameras.map(Camera::center).collect();
    let true_centers: Vec<_> = centers(&mut scene.train.iter().map(|v| &v.camera));
    let mut off = scene.clone();
    for (view, map) in off.train.iter_mut().zip(maps) {
        view.camera = map.camera.clone();
    }
    off.cloud = cloud(maps, CloudOptions { share: 1.0 }).points;
    let prepared = prepare(&off, config, &mut Seconds::default())?;
    let gpu = Gpu::open()?;
    let kernels = Kernels::new(&gpu);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let trained = train(&gpu, &kernels, start, supervision, config, &mut ())?;
    let to_world = |camera: &Camera| prepared.frame.camera_to_world(camera);
    let cameras: Vec<Camera> = trained.cameras.iter().map(to_world).collect();
    let similarity = Similarity::between(&true_centers, &centers(&mut cameras.iter()))?;
    let mut test = scene.test.clone();
    for view in &mut test {
        view.camera = similarity.camera(&view.camera);
    }
    let device = Device {
        gpu: &gpu,
        kernels: &kernels,
    };
    let fitted = fit_poses(device, &trained.gaussians, &prepared.frame, &test, config)?;
    for (view, camera) in test.iter_mut().zip(fitted) {
        view.camera = camera;
    }
    let frame = &prepared.frame;
    let scores = mean_scores(device, &trained.gaussians, frame, &test, config)?;
    Ok(scores.map(Cell::from))
}
