//! This study compares few and more training views (Table 5).

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, gain, psnr_at, quality, scenes};
use super::runs::Results;
use super::{Picture, Report, Study};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::field::angle;
use crate::pipeline::{TrainJob, focus_of};
use crate::report::plot::{Axis, Plot, Style};
use crate::report::{Column, Table};
use crate::scene::View;

const COUNTS: [usize; 5] = [3, 4, 5, 6, 9];
const PRESETS: [&str; 2] = ["3dgs", "paper"];

fn name(preset: &str, count: usize) -> String {
    format!("{preset}-views-{count}")
}

pub(crate) struct Views;

impl Study for Views {
    fn question(&self) -> &'static str {
        "How the method and its baseline fare with 3 to 9 training views (the paper's Table 5)."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let scene = base.scene()?;
        let (focus, _) = focus_of(&scene)?;
        let all: Vec<&View> = scene.train.iter().chain(&scene.test).collect();
        let cameras: Vec<Camera> = all.iter().map(|view| view.camera.clone()).collect();
        let order = spread_order(&cameras, scene.train.len(), focus.center);
        // Some view must be left to test at.
        let counts = COUNTS.into_iter().filter(|n| *n < all.len());
        let counts: Vec<usize> = counts.collect();
        let Some(&most) = counts.last() else {
            return Err(
                Error::new(format!("has {} views, too few to study", all.len()))
                    .at(format!("scene `{}`", base.name())),
            );
        };
        let names = |chosen: &[usize]| -> Vec<String> {
            let chosen = chosen.iter().map(|&i| cameras[i].name.clone());
            chosen.collect()
        };
        let trained = names(&order[..most]);
        let test = scene.test.iter().map(|view| view.camera.name.clone());
        let test: Vec<String> = test.filter(|name| !trained.contains(name)).collect();
        let mut variants = Vec::new();
        for count in counts {
            for preset in PRESETS {
                let Variant { name, job } = base.variant(&name(preset, count), preset, &[])?;
                let job = TrainJob {
                    train_views: Some(names(&order[..count])),
                    test_views: Some(test.clone()),
                    ..job
                };
                variants.push(Variant { name, job });
            }
        }
        Ok(variants)
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let columns = [
            SCENE,
            Column::text("views", "views"),
            Column::text("preset", "preset"),
            PSNR,
            SSIM,
            LPIPS,
            TO_MODEL,
            Column::quantity("gain", "over 3dgs, dB"),
        ];
        let mut table = Table::new("views", &columns);
        for scope in results.scopes() {
            for count in COUNTS {
                for preset in PRESETS.into_iter().filter(|p| scope.has(&name(p, count))) {
                    let variant = name(preset, count);
                    let gained = match preset {
                        "3dgs" => String::new(),
                        _ => gain(&scope, &variant, &name("3dgs", count)),
                    };
                    let head = [
                        scope.name.clone().into(),
                        count.to_string().into(),
                        preset.into(),
                    ];
                    let cells = head.into_iter().chain(quality(&scope, &variant));
                    table.row(cells.chain([gained.into()]));
                }
            }
        }
        let mut plot = Plot::new(
            "PSNR at the same test views",
            Axis::linear("training views"),
            Axis::linear("PSNR, dB"),
        );
        for scope in scenes(results) {
            for preset in PRESETS {
                let counts = COUNTS.into_iter();
                let point = |n: usize| psnr_at(&scope, &name(preset, n), n as f64);
                let label = format!("{}, {preset}", scope.name);
                plot = plot.with(&label, Style::Curve, counts.filter_map(point).collect());
            }
        }
        Ok(Report {
            tables: vec![table],
            pictures: vec![Picture {
                name: "views".to_owned(),
                svg: plot.to_svg()?,
            }],
            notes: vec![
                "Each row's training views are among those of the next: the scene's own first, \
                 then one after another the view farthest in angle from those before it. No \
                 row tests at a view that any row trains on. The cloud is the scene's own \
                 throughout."
                    .to_owned(),
            ],
        })
    }
}

/// Returns the order in which views are taken for training: the first `n_first` before the others,
/// and among either, after the first, always the one whose angle around `center` to the nearest of
/// those before it is largest (the first of equals). Indices into `cameras`.
pub fn spread_order(cameras: &[Camera], n_first: usize, center: glam::DVec3) -> Vec<usize> {
    let direction = |camera: &Camera| (camera.center() - center).normalize_or(-camera.forward());
    let directions: Vec<glam::DVec3> = cameras.iter().map(direction).collect();
    let mut order: Vec<usize> = Vec::with_capacity(cameras.len());
    while order.len() < cameras.len() {
        let group = if order.len() < n_first {
            0..n_first.min(cameras.len())
        } else {
            0..cameras.len()
        };
        let nearest = |i: usize| -> f64 {
            let angles = order.iter().map(|&j| angle(directions[i], directions[j]));
            angles.fold(f64::INFINITY, f64::min)
        };
        let left = group.filter(|i| !order.contains(i));
        let farthest = left.reduce(|a, b| if nearest(b) > nearest(a) { b } else { a });
        order.extend(farthest);
    }
    order
}
