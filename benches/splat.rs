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
use gspotential::cloud::splat::{SplatImage, splat_depths, splat_views};
use gspotential::cloud::warp::Warp;
use gspotential::config::{ColorSource, Config, Footprint, SplatConfig};
use gspotential::error::Result;
use gspotential::eval::score_splats;
use gspotential::field::{Field, Focus};
use gspotential::report::{Column, Table};
use gspotential::scene::{CloudSource, LoadOptions, Scene, View};
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

const COLOR_COLUMNS: [Column; 8] = [
    Column::text("px", "px"),
    Column::text("colors", "colours"),
    Column::number("seen", "% of test pixels that a photograph sees", 1),
    Column::number("seen_psnr", "there, dB", 2),
    Column::number("smooth_psnr", "there, means of 5x5 px, dB", 2),
    Column::number("weighed_psnr", "covered, by weight, dB", 2),
    Column::number("weight", "mean weight of covered", 2),
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
    let mut colors = Table::new("splat-colors", &COLOR_COLUMNS);
    for size in &args.max_size {
        let options = LoadOptions {
            cloud: args.cloud.clone().map(CloudSource::File),
            ..LoadOptions::new(&config)
        };
        let scene = args.on.load(*size, options)?;
        compare(&scene, &config, &splats, args.rounds, &mut table)?;
        compare_colors(&scene, &config, args.rounds, &mut colors)?;
    }
    print!("{table}\n{colors}");
    Ok(())
}

/// The virtual cameras that `config` asks for, with the scene's frame.
fn virtual_cameras(
    scene: &Scene,
    train: &[Camera],
    config: &Config,
) -> Result<(Frame, Vec<Camera>)> {
    let focus = Focus::find(train, &scene.cloud)?;
    let field = Field::new(train, &focus, &config.field);
    let views = virtual_views(train, &focus, &field, None, config)?;
    Ok((focus.frame(), views.into_iter().map(|v| v.camera).collect()))
}

fn cameras(views: &[View]) -> Vec<Camera> {
    views.iter().map(|view| view.camera.clone()).collect()
}

/// What colours the discs, at the test views: on the same pixels, those that some photograph sees.
fn compare_colors(scene: &Scene, config: &Config, rounds: usize, table: &mut Table) -> Result<()> {
    let (train, test) = (cameras(&scene.train), cameras(&scene.test));
    let (frame, views) = virtual_cameras(scene, &train, config)?;
    let near = frame.near(config.model.near);
    let made = |colors: ColorSource, cameras: &[Camera]| {
        let config = Config {
            splat: SplatConfig {
                colors,
                footprint: Footprint::Disc,
                ..config.splat.clone()
            },
            ..config.clone()
        };
        let mut images = splat_views(&scene.cloud, &frame, (cameras, &train), &config.splat, near)?;
        let warp = Warp::new(&scene.cloud, &frame, &scene.train, &config, near)?;
        let seen = match warp {
            Some(warp) => warp.paint(cameras, &mut images)?,
            None => Vec::new(),
        };
        Ok((images, seen))
    };
    let mut plain_s = None;
    let (_, seen) = made(ColorSource::Photographs, &test)?;
    for (colors, name) in [
        (ColorSource::Points, "points"),
        (ColorSource::Photographs, "photographs"),
        (ColorSource::Blend, "blend"),
    ] {
        let mut taken = f64::INFINITY;
        for _ in 0..rounds {
            let start = Instant::now();
            made(colors, &views)?;
            taken = taken.min(start.elapsed().as_secs_f64());
        }
        let (images, _) = made(colors, &test)?;
        let errors = images.iter().zip(&scene.test).zip(&seen);
        let errors: Vec<ColorErrors> = errors
            .map(|((image, view), seen)| ColorErrors::of(image, view, seen))
            .collect();
        let mean =
            |of: fn(&ColorErrors) -> f64| errors.iter().map(of).sum::<f64>() / errors.len() as f64;
        table.row([
            format!("{}x{}", train[0].width, train[0].height).into(),
            name.into(),
            (100.0 * mean(|e| e.seen_share)).into(),
            mean(|e| e.seen_psnr).into(),
            mean(|e| e.smooth_psnr).into(),
            mean(|e| e.weighed_psnr).into(),
            mean(|e| e.mean_weight).into(),
            (taken / *plain_s.get_or_insert(taken)).into(),
        ]);
    }
    Ok(())
}

/// Errors of one image against a photograph.
struct ColorErrors {
    seen_share: f64,
    seen_psnr: f64,
    smooth_psnr: f64,
    weighed_psnr: f64,
    mean_weight: f64,
}

impl ColorErrors {
    fn of(image: &SplatImage, view: &View, seen: &[bool]) -> ColorErrors {
        let pixels = image
            .rgba
            .chunks_exact(4)
            .zip(view.image.rgb.chunks_exact(3));
        let errors: Vec<[f64; 3]> = pixels
            .map(|(a, b)| [0, 1, 2].map(|c| (f64::from(a[c]) - f64::from(b[c])) / 255.0))
            .collect();
        let weights: Vec<f64> = image
            .rgba
            .chunks_exact(4)
            .map(|p| f64::from(p[3]) / 255.0)
            .collect();
        let seen_weights: Vec<f64> = seen.iter().map(|seen| f64::from(u8::from(*seen))).collect();
        let smooth = smoothed(&errors, seen, image.width as usize);
        let n_covered = weights.iter().filter(|w| **w > 0.0).count();
        ColorErrors {
            seen_share: seen_weights.iter().sum::<f64>() / seen.len() as f64,
            seen_psnr: psnr(&errors, &seen_weights),
            smooth_psnr: psnr(&smooth, &seen_weights),
            weighed_psnr: psnr(&errors, &weights),
            mean_weight: weights.iter().sum::<f64>() / n_covered as f64,
        }
    }
}

fn psnr(errors: &[[f64; 3]], weights: &[f64]) -> f64 {
    let squares = errors
        .iter()
        .map(|e| e.iter().map(|e| e * e).sum::<f64>() / 3.0);
    let sum: f64 = squares
        .zip(weights)
        .map(|(square, weight)| square * weight)
        .sum();
    -10.0 * (sum / weights.iter().sum::<f64>()).log10()
}

/// The mean of the errors that count, over 5x5 pixels around each.
fn smoothed(errors: &[[f64; 3]], counts: &[bool], width: usize) -> Vec<[f64; 3]> {
    let height = errors.len() / width;
    let around = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for row in y.saturating_sub(2)..=(y + 2).min(height - 1) {
            for other in row * width + x.saturating_sub(2)..=row * width + (x + 2).min(width - 1) {
                if counts[other] {
                    sum = std::array::from_fn(|c| sum[c] + errors[other][c]);
                    n += 1.0;
                }
            }
        }
        sum.map(|sum| sum / f64::max(n, 1.0))
    };
    (0..errors.len()).map(around).collect()
}

fn compare(
    scene: &Scene,
    config: &Config,
    splats: &[SplatConfig],
    rounds: usize,
    table: &mut Table,
) -> Result<()> {
    let (train, test) = (cameras(&scene.train), cameras(&scene.test));
    let (frame, views) = virtual_cameras(scene, &train, config)?;
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
        colors: ColorSource::Points,
        outline: false,
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
