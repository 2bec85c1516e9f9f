//! What the footprint of a splatted point makes of the virtual views: how much they cover, how much
//! of it lies behind a surface, how the same splat compares with photographs, and what it takes.
//!
//! `cargo bench --bench splat -- [--scene DIR|builtin:WIDTH] [--cloud FILE] [--max-size PX,...]
//! [--set KEY=VALUE]...`
//!
//! A covered pixel is hidden where its point lies over 5 % of its depth behind the surface. No file
//! says where the surface is, so it is judged by the same points whatever the footprint: a pixel is
//! behind it if nearer ones surround it, that is, if in three or more of the four quadrants of the
//! window around it a point of the cloud is nearer by over 5 %. Beside an edge they are on one or two
//! sides alone. The window is wide enough that a surface shows 12 points in it on average.

mod kit;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use gspotential::camera::{Camera, Frame};
use gspotential::cloud::splat::{splat_depths, splat_views};
use gspotential::config::{Config, Footprint, SplatConfig};
use gspotential::error::Result;
use gspotential::eval::score_splats;
use gspotential::field::{Field, Focus};
use gspotential::report::{Column, Table};
use gspotential::scene::{CloudSource, LoadOptions, Scene};
use gspotential::views::virtual_views;

use kit::SceneArgs;

/// How far behind the surface a point is hidden, as a share of its depth.
const BEHIND: f64 = 0.05;

const COLUMNS: [Column; 9] = [
    Column::text("px", "px"),
    Column::text("footprint", "footprint"),
    Column::number("coverage", "% covered", 1),
    Column::number("hidden", "% hidden, mean", 2),
    Column::number("hidden_worst", "% hidden, worst view", 1),
    Column::number("psnr", "test views, dB", 2),
    Column::number("covered_psnr", "where covered, dB", 2),
    Column::number("test_coverage", "% covered", 1),
    Column::number("time", "time ratio", 2),
];

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long)]
    cloud: Option<PathBuf>,
    #[arg(long, value_delimiter = ',', default_value = "320")]
    max_size: Vec<u32>,
    /// Greatest radii of discs to compare, pixels
    #[arg(long, value_delimiter = ',', default_value = "4")]
    radii: Vec<f64>,
    /// Depth tolerances of discs to compare
    #[arg(long, value_delimiter = ',', default_value = "0.02")]
    tolerances: Vec<f64>,
    #[arg(long, default_value_t = 3)]
    rounds: usize,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let config = args.on.config("paper")?;
    let mut splats = vec![SplatConfig {
        footprint: Footprint::Pixel,
        ..config.splat.clone()
    }];
    for max_radius_px in &args.radii {
        splats.extend(args.tolerances.iter().map(|depth_tolerance| SplatConfig {
            footprint: Footprint::Disc,
            max_radius_px: *max_radius_px,
            depth_tolerance: *depth_tolerance,
            ..config.splat.clone()
        }));
    }
    let mut table = Table::new("splat", &COLUMNS);
    for size in &args.max_size {
        let options = LoadOptions {
            cloud: args.cloud.clone().map(CloudSource::File),
            ..LoadOptions::new(&config)
        };
        let scene = args.on.load(*size, options)?;
        compare(&scene, &config, &splats, args.rounds, &mut table)?;
    }
    print!("{table}");
    Ok(())
}

fn compare(
    scene: &Scene,
    config: &Config,
    splats: &[SplatConfig],
    rounds: usize,
    table: &mut Table,
) -> Result<()> {
    let cameras = |views: &[gspotential::scene::View]| -> Vec<Camera> {
        views.iter().map(|view| view.camera.clone()).collect()
    };
    let (train, test) = (cameras(&scene.train), cameras(&scene.test));
    let focus = Focus::find(&train, &scene.cloud)?;
    let field = Field::new(&train, &focus, &config.field);
    let frame = focus.frame();
    let views = virtual_views(&train, &focus, &field, None, config)?;
    let views: Vec<Camera> = views.into_iter().map(|v| v.camera).collect();
    let near = config.model.near;
    let fronts = fronts(scene, &frame, &views, near)?;
    let mut seconds = vec![f64::INFINITY; splats.len()];
    for _ in 0..rounds {
        for (least, splat) in seconds.iter_mut().zip(splats) {
            let start = Instant::now();
            splat_views(&scene.cloud, &frame, (&views, &train), splat, near)?;
            *least = least.min(start.elapsed().as_secs_f64());
        }
    }
    for (splat, taken) in splats.iter().zip(&seconds) {
        let depths = splat_depths(&scene.cloud, &frame, (&views, &train), splat, near)?;
        let shares: Vec<[f64; 2]> = depths
            .iter()
            .zip(&fronts)
            .map(|(depths, front)| shares(depths, front))
            .collect();
        let mean = |which: usize| {
            100.0 * shares.iter().map(|s| s[which]).sum::<f64>() / shares.len() as f64
        };
        let worst = shares.iter().map(|s| s[1]).fold(0.0, f64::max);
        let images = splat_views(&scene.cloud, &frame, (&test, &train), splat, near)?;
        let score = score_splats(&images, &scene.test)?;
        let name = match splat.footprint {
            Footprint::Pixel => "pixel".to_owned(),
            Footprint::Disc => format!(
                "disc, {} px, {}",
                splat.max_radius_px, splat.depth_tolerance
            ),
        };
        let (width, height) = (train[0].width, train[0].height);
        table.row([
            format!("{width}x{height}").into(),
            name.into(),
            mean(0).into(),
            mean(1).into(),
            (100.0 * worst).into(),
            score.psnr.into(),
            score.psnr_covered.into(),
            (100.0 * score.coverage).into(),
            (taken / seconds[0]).into(),
        ]);
    }
    Ok(())
}

/// Share of covered pixels, and share of those that are hidden.
fn shares(depths: &[f32], front: &[f32]) -> [f64; 2] {
    let covered = depths.iter().filter(|d| d.is_finite()).count();
    let hidden = depths
        .iter()
        .zip(front)
        .filter(|(d, front)| d.is_finite() && f64::from(**d) * (1.0 - BEHIND) > f64::from(**front));
    [
        covered as f64 / depths.len() as f64,
        hidden.count() as f64 / covered.max(1) as f64,
    ]
}

/// In every pixel of every view, the depth in front of which three quadrants of its window have a
/// point: the third smallest of the least depths in the four, of single pixels without a filter.
fn fronts(scene: &Scene, frame: &Frame, views: &[Camera], near: f64) -> Result<Vec<Vec<f32>>> {
    let bare = SplatConfig {
        footprint: Footprint::Pixel,
        max_radius_px: 1.0,
        depth_tolerance: 0.0,
        filter_window_px: 1,
        filter_min_neighbors: 0,
    };
    let depths = splat_depths(&scene.cloud, frame, (views, &[]), &bare, near)?;
    let fronts = depths.iter().zip(views).map(|(depths, view)| {
        let (width, height) = (view.width as usize, view.height as usize);
        let n_covered = depths.iter().filter(|d| d.is_finite()).count();
        // 3 of a quadrant's (reach + 1)^2 pixels.
        let density = n_covered as f64 / depths.len() as f64;
        let reach = ((3.0 / density.max(1e-3)).sqrt().ceil() as usize).max(2) - 1;
        (0..depths.len())
            .map(|pixel| {
                let (x, y) = (pixel % width, pixel / width);
                let columns = [x.saturating_sub(reach)..=x, x..=(x + reach).min(width - 1)];
                let rows = [y.saturating_sub(reach)..=y, y..=(y + reach).min(height - 1)];
                let mut quadrants = [0, 1, 2, 3].map(|i: usize| {
                    let inside = rows[i / 2].clone().flat_map(|row| {
                        columns[i % 2]
                            .clone()
                            .map(move |column| row * width + column)
                    });
                    inside
                        .filter(|other| *other != pixel)
                        .map(|other| depths[other])
                        .fold(f32::INFINITY, f32::min)
                });
                quadrants.sort_by(f32::total_cmp);
                quadrants[2]
            })
            .collect()
    });
    Ok(fronts.collect())
}
