//! This study shows the field on the sphere, and what predicts the quality of a test view.

use glam::DVec3;

use super::plan::{Base, Variant};
use super::quality::{SCENE, TO_MODEL, to_model};
use super::runs::{Finished, Results};
use super::viewpoints::{Setting, cameras, correlations, scatter};
use super::{Picture, Report, Study, file_name};
use crate::camera::compass::Compass;
use crate::camera::json::read_cameras;
use crate::cloud::splat::splat_views;
use crate::error::Result;
use crate::report::plot::{MapMark, SphereMap};
use crate::report::stats::Figure;
use crate::report::{Column, Table};

const PRESETS: [&str; 3] = ["3dgs", "paper", "gspotential"];

const COLUMNS: [Column; 6] = [
    SCENE,
    Column::text("preset", "preset"),
    Column::text("predictor", "predictor"),
    Column::figure("spearman", "Spearman", 3),
    Column::figure("partial", "at equal angle", 3),
    TO_MODEL,
];

pub(crate) struct Potential;

impl Study for Potential {
    fn question(&self) -> &'static str {
        "What the camera potential field looks like on the sphere, and how well it predicts the \
         PSNR of a test view, against the angle to the nearest training view and against how much \
         of the view the cloud covers."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        base.presets(&PRESETS)
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let mut report = Report {
            notes: vec![
                "Spearman: rank correlation of a test view's PSNR with the predictor. At equal \
                 angle: the partial rank correlation given the angle to the nearest training \
                 view. Coverage: the share of the test view's pixels in which the cloud's splat \
                 has a point. The field is the method's."
                    .to_owned(),
            ],
            ..Report::default()
        };
        let mut table = Table::new("potential", &COLUMNS);
        for scene in results.scenes() {
            let Some(run) = results.of(scene, "paper").into_iter().next() else {
                continue;
            };
            let setting = Setting::of(run)?;
            report.pictures.extend(maps(scene, &setting, run)?);
            let predictors = predictors(&setting, run)?;
            let angles = &predictors[1].1;
            for preset in PRESETS {
                let runs = results.of(scene, preset);
                let psnr: Vec<Vec<f64>> = runs.iter().map(|run| psnr_by_view(run)).collect();
                let seconds = Figure::of(runs.iter().map(|run| to_model(run)));
                for (label, values) in &predictors {
                    let [whole, partial] = correlations(values, &psnr, angles);
                    table.row([
                        scene.into(),
                        preset.into(),
                        (*label).into(),
                        whole.into(),
                        partial.into(),
                        seconds.into(),
                    ]);
                }
                for i in [0, 3] {
                    let (label, values) = &predictors[i];
                    let title = format!("{scene}: test views of {preset}");
                    report.pictures.push(Picture {
                        name: file_name(&["potential", scene, preset, label]),
                        svg: scatter(&title, (label, values), &psnr, angles).to_svg()?,
                    });
                }
            }
        }
        report.tables.push(table);
        Ok(report)
    }
}

fn psnr_by_view(run: &Finished) -> Vec<f64> {
    let views = run.evaluation.views.iter();
    views.map(|v| v.psnr.unwrap_or(f64::INFINITY)).collect()
}

/// Returns what may tell the quality of each test view; the second is the angle to the nearest
/// view.
fn predictors(setting: &Setting, run: &Finished) -> Result<[(&'static str, Vec<f64>); 4]> {
    let test = cameras(&setting.scene.test);
    let directions: Vec<DVec3> = test.iter().map(|c| setting.direction(c)).collect();
    let over = |value: &dyn Fn(DVec3) -> f64| directions.iter().map(|d| value(*d)).collect();
    let (field, config) = (&setting.field, &run.job.config);
    let near = setting.frame.near(config.model.near);
    let splats = splat_views(
        &setting.scene.cloud,
        &setting.frame,
        (&test, &cameras(&setting.scene.train)),
        &config.splat,
        near,
    )?;
    Ok([
        ("U_info", over(&|d| field.u_info(d))),
        ("nearest angle", over(&|d| setting.nearest_deg(d))),
        ("U_total", over(&|d| field.u_total(d))),
        (
            "coverage",
            splats.iter().map(|splat| splat.coverage()).collect(),
        ),
    ])
}

/// Draws the field's three potentials, with every camera of `run` on them.
fn maps(scene: &str, setting: &Setting, run: &Finished) -> Result<Vec<Picture>> {
    let direction = |camera: &_| setting.direction(camera);
    let train = cameras(&setting.scene.train);
    let test = cameras(&setting.scene.test);
    let all = read_cameras(&run.run.cameras())?;
    let drawn = all.iter().filter(|c| c.name.starts_with("virtual_"));
    let mark = |name: &str, directions: Vec<DVec3>, color: [u8; 3], size_px: u32| MapMark {
        name: name.to_owned(),
        directions,
        color,
        size_px,
    };
    let marks = vec![
        mark(
            "virtual",
            drawn.map(direction).collect(),
            [255, 255, 255],
            2,
        ),
        mark(
            "test",
            test.iter().map(direction).collect(),
            [230, 159, 0],
            3,
        ),
        mark(
            "training",
            train.iter().map(direction).collect(),
            [213, 94, 0],
            6,
        ),
    ];
    let up = train.iter().map(|camera| camera.up()).sum::<DVec3>();
    let front = train.first().map_or(DVec3::X, direction);
    let compass = Compass::new(up.normalize_or(DVec3::Z), front)?;
    let field = &setting.field;
    let u_info = |d: DVec3| field.u_info(d);
    let u_conf = |d: DVec3| field.u_conf(d);
    let u_total = |d: DVec3| field.u_total(d);
    let potentials: [(&str, &dyn Fn(DVec3) -> f64); 3] = [
        ("U_info", &u_info),
        ("U_conf", &u_conf),
        ("U_total", &u_total),
    ];
    let pictures = potentials.into_iter().map(|(name, value)| {
        let map = SphereMap {
            title: format!("{scene}: {name}"),
            color_label: name.to_owned(),
            range: None,
            value,
            compass,
            marks: marks.clone(),
        };
        Ok(Picture {
            name: file_name(&["potential", scene, name]),
            svg: map.to_svg()?,
        })
    });
    pictures.collect()
}
