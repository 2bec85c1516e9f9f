//! The pilot study asks how well 3DGS renders each direction around a scene, trained on one camera
//! and on all (the paper's first figure of the field).

use std::ops::Range;

use glam::DVec3;

use super::plan::{Base, Variant};
use super::quality::{LPIPS, PSNR, SCENE, SSIM, TO_MODEL, difference, quality};
use super::runs::{Finished, Results};
use super::viewpoints::{Setting, cameras, psnr_at};
use super::{Picture, Report, Study, file_name};
use crate::camera::Camera;
use crate::camera::compass::Compass;
use crate::error::{Error, Result};
use crate::field::{Field, angle};
use crate::gpu::Gpu;
use crate::pipeline::{TrainJob, focus_of};
use crate::report::plot::{MapMark, SphereMap};
use crate::report::stats::Figure;
use crate::report::{Cell, Column, Table};
use crate::scene::{CloudSource, SceneSource, View};

/// On the scene's own split and cloud.
const ALL: &str = "3dgs";
/// On the first of its training views.
const ONE: &str = "3dgs-one-camera";
const LAYOUTS: [(&str, &str); 2] = [(ONE, "1 camera"), (ALL, "all cameras")];

/// Directions tried on the sphere: 6.4 degrees apart.
const N_DIRECTIONS: usize = 1000;

/// The map shows the nearest viewpoint within this, degrees, and is blank elsewhere.
const REACH_DEG: f64 = 6.5;

/// Viewpoints within this of a place between two cameras, or of either, are averaged, degrees.
const NEAR_DEG: f64 = 12.0;

/// Bounds of the table's angles, degrees.
const BOUNDS: [f64; 8] = [0.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0];

pub(crate) struct Pilot;

impl Study for Pilot {
    fn question(&self) -> &'static str {
        "How well 3DGS renders each direction around the scene, trained on one camera and on all \
         (the paper's pilot study): whether quality peaks at the cameras, and whether valleys lie \
         between them."
    }

    fn variants(&self, base: &Base) -> Result<Vec<Variant>> {
        let all = base.variant(ALL, "3dgs", &[])?;
        let scene = all.job.load()?;
        if scene.train.len() < 2 {
            return Err(
                Error::new("has 1 training view: nothing to compare it with")
                    .at(format!("scene `{}`", base.name()))
                    .way_out("name 2 or more in its split.json"),
            );
        }
        let names = |views: &[View]| -> Vec<String> {
            let names = views.iter().map(|view| view.camera.name.clone());
            names.collect()
        };
        let Variant { name, job } = base.variant(ONE, "3dgs", &[])?;
        let one = TrainJob {
            train_views: Some(names(&scene.train[..1])),
            test_views: Some(names(&scene.test)),
            // What one view shows, where the cloud can be made of it alone.
            cloud: match base.source() {
                SceneSource::Folder(_) => None,
                SceneSource::Builtin { .. } | SceneSource::Object { .. } => {
                    Some(CloudSource::Views(1))
                }
            },
            ..job
        };
        Ok(vec![Variant { name, job: one }, all])
    }

    fn report(&self, results: &Results) -> Result<Report> {
        let gpu = Gpu::open()?;
        let (mut by_angle, mut valleys) = (angle_table(), valley_table());
        let mut pictures = Vec::new();
        let mut notes = vec![
            "Viewpoints lie on the sphere of the whole training set: of the built-in scene all \
             over it, outside objects and above the floor, against ray-traced truth, and its \
             single camera has the cloud of that view alone; of a folder they are its test views, \
             and the cloud is the same. A map shows the nearest viewpoint and is blank where \
             there is none. Angles are to the nearest camera that was trained on."
                .to_owned(),
        ];
        for scene in results.scenes() {
            let surveys = surveys(&gpu, results, scene)?;
            let [one, all] = &surveys;
            angle_rows(&mut by_angle, scene, &surveys);
            valley_rows(&mut valleys, scene, all);
            notes.push(format!("{scene}: {}", claims(one, all)));
            let range = common_range(&surveys);
            for (survey, (_, label)) in surveys.iter().zip(LAYOUTS) {
                pictures.push(Picture {
                    name: file_name(&["pilot", scene, label]),
                    svg: survey.map(&format!("{scene}: 3DGS, {label}"), &range)?,
                });
            }
        }
        Ok(Report {
            tables: vec![quality_table(results), by_angle, valleys],
            pictures,
            notes,
        })
    }
}

/// Measures of what a variant renders at the viewpoints.
struct Surveyed {
    /// Unit directions of the viewpoints from the focus of all cameras.
    directions: Vec<DVec3>,
    /// Places of the cameras that it was trained on, with their names.
    trained: Vec<(String, DVec3)>,
    compass: Compass,
    /// To the nearest of them, degrees.
    angles: Vec<f64>,
    /// dB, of every seed.
    psnr: Vec<Vec<f64>>,
}

/// Surveys one camera and all, from the same viewpoints.
fn surveys(gpu: &Gpu, results: &Results, scene: &str) -> Result<[Surveyed; 2]> {
    let runs = |variant: &str| {
        let runs = results.of(scene, variant);
        match runs.first() {
            Some(first) => Ok((runs.clone(), *first)),
            None => Err(Error::new(format!("there is no run `{variant}`")).at(scene)),
        }
    };
    let (all_runs, first) = runs(ALL)?;
    let setting = Setting::of(first)?;
    let views = setting.viewpoints(N_DIRECTIONS)?;
    let directions = views.iter().map(|view| setting.direction(&view.camera));
    let directions: Vec<DVec3> = directions.collect();
    let train = cameras(&setting.scene.train);
    let compass = Compass::of_cameras(&train, setting.focus.center)?;
    let survey = |runs: &[&Finished], train: &[Camera], frame| {
        let field = Field::new(train, &setting.focus, &first.job.config.field);
        let angles = directions.iter().map(|d| field.u_conf(*d).to_degrees());
        let names = train.iter().map(|camera| camera.name.clone());
        Ok::<_, Error>(Surveyed {
            angles: angles.collect(),
            trained: names.zip(field.directions).collect(),
            compass,
            psnr: psnr_at(gpu, runs, frame, &views)?,
            directions: directions.clone(),
        })
    };
    let (one_runs, one) = runs(ONE)?;
    let one_scene = one.job.load()?;
    let (_, one_frame) = focus_of(&one_scene)?;
    Ok([
        survey(&one_runs, &cameras(&one_scene.train), &one_frame)?,
        survey(&all_runs, &train, &setting.frame)?,
    ])
}

impl Surveyed {
    /// Returns the mean PSNR of the viewpoints for which `holds`, by index, and how many they are;
    /// `None` if there are none.
    fn mean_where(&self, holds: impl Fn(usize) -> bool) -> Group {
        let chosen: Vec<usize> = (0..self.angles.len()).filter(|&i| holds(i)).collect();
        let n = chosen.len();
        let mean = |psnr: &Vec<f64>| chosen.iter().map(|&i| psnr[i]).sum::<f64>() / n as f64;
        let psnr = Figure::of(self.psnr.iter().map(|psnr| (n > 0).then(|| mean(psnr))));
        Group { psnr, n }
    }

    fn within(&self, bounds: Range<f64>) -> Group {
        // Nothing is beyond the last bound, which belongs to the last range.
        let last = bounds.end >= 180.0;
        self.mean_where(|i| bounds.contains(&self.angles[i]) || last && self.angles[i] >= 180.0)
    }

    /// Returns the mean PSNR near any of some directions.
    fn near(&self, places: &[DVec3]) -> Option<Figure> {
        let near = |d: DVec3| places.iter().any(|p| angle(d, *p).to_degrees() <= NEAR_DEG);
        self.mean_where(|i| near(self.directions[i])).psnr
    }

    /// Returns the mean PSNR at each viewpoint, over the seeds.
    fn mean_psnr(&self) -> Vec<f64> {
        let mean = |i: usize| {
            let seeds = self.psnr.iter().map(|seed| seed[i]);
            seeds.sum::<f64>() / self.psnr.len() as f64
        };
        (0..self.angles.len()).map(mean).collect()
    }

    fn map(&self, title: &str, range: &Option<Range<f64>>) -> Result<String> {
        let psnr = self.mean_psnr();
        let reach = REACH_DEG.to_radians().cos();
        let value = |direction: DVec3| {
            let cosines = self.directions.iter().map(|d| d.dot(direction));
            let nearest = cosines.zip(&psnr).max_by(|a, b| a.0.total_cmp(&b.0));
            nearest
                .filter(|(cos, _)| *cos >= reach)
                .map_or(f64::NAN, |n| *n.1)
        };
        let map = SphereMap {
            title: title.to_owned(),
            color_label: "PSNR, dB".to_owned(),
            value: &value,
            range: range.clone(),
            compass: self.compass,
            marks: vec![MapMark {
                name: "training".to_owned(),
                directions: self
                    .trained
                    .iter()
                    .map(|(_, direction)| *direction)
                    .collect(),
                color: [213, 94, 0],
                size_px: 6,
            }],
        };
        map.to_svg()
    }

    /// Finds the pairs of cameras with no third as near to the middle between them as they are.
    /// Opposite cameras have no middle.
    fn neighbours(&self) -> Vec<Neighbours> {
        let at = |i: usize| self.trained[i].1;
        let n = self.trained.len();
        let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
        let with_middle = pairs.filter_map(|(i, j)| {
            let middle = (at(i) + at(j)).try_normalize()?;
            Some(Neighbours { i, j, middle })
        });
        let is_free = |&Neighbours { i, j, middle }: &Neighbours| {
            let half = angle(at(i), middle);
            (0..n).all(|k| k == i || k == j || angle(at(k), middle) > half)
        };
        with_middle.filter(is_free).collect()
    }
}

/// PSNR at some of the viewpoints.
struct Group {
    /// The mean, over seeds; none without a viewpoint.
    psnr: Option<Figure>,
    n: usize,
}

/// Two cameras beside each other, by index, and the direction of the middle between them.
struct Neighbours {
    i: usize,
    j: usize,
    middle: DVec3,
}

/// Returns the least and greatest of both, so that the maps' colours say the same.
fn common_range(surveys: &[Surveyed; 2]) -> Option<Range<f64>> {
    let values: Vec<f64> = surveys.iter().flat_map(Surveyed::mean_psnr).collect();
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let (least, greatest) = (finite().reduce(f64::min)?, finite().reduce(f64::max)?);
    Some(least..greatest)
}

fn quality_table(results: &Results) -> Table {
    let columns = [
        SCENE,
        Column::text("cameras", "3dgs from"),
        PSNR,
        SSIM,
        LPIPS,
        TO_MODEL,
    ];
    let mut table = Table::new("pilot", &columns);
    for scope in results.scopes() {
        for (variant, label) in LAYOUTS {
            let head: [Cell; 2] = [scope.name.clone().into(), label.into()];
            table.row(head.into_iter().chain(quality(&scope, variant)));
        }
    }
    table
}

fn angle_table() -> Table {
    let columns = [
        SCENE,
        Column::text("angle", "degrees to the nearest camera"),
        Column::figure("psnr_one", "1 camera, PSNR dB", 2),
        Column::figure("n_one", "viewpoints", 0),
        Column::figure("psnr_all", "all cameras, PSNR dB", 2),
        Column::figure("n_all", "viewpoints", 0),
    ];
    Table::new("pilot-angle", &columns)
}

fn angle_rows(table: &mut Table, scene: &str, surveys: &[Surveyed; 2]) {
    for bounds in BOUNDS.windows(2) {
        let mut cells: Vec<Cell> = vec![
            scene.into(),
            format!("{} to {}", bounds[0], bounds[1]).into(),
        ];
        for survey in surveys {
            let Group { psnr, n } = survey.within(bounds[0]..bounds[1]);
            cells.extend([psnr.into(), n.into()]);
        }
        table.row(cells);
    }
}

fn valley_table() -> Table {
    let columns = [
        SCENE,
        Column::text("pair", "neighbouring cameras"),
        Column::figure("gap", "degrees apart", 0),
        Column::figure("ends", "at either, PSNR dB", 2),
        Column::figure("middle", "midway, PSNR dB", 2),
        Column::quantity("drop", "drop, dB"),
    ];
    Table::new("pilot-valleys", &columns)
}

/// Adds the quality at two neighbouring cameras and midway between them.
fn valley_rows(table: &mut Table, scene: &str, survey: &Surveyed) {
    for Neighbours { i, j, middle } in survey.neighbours() {
        let [(a, from), (b, to)] = [&survey.trained[i], &survey.trained[j]];
        let (ends, midway) = (survey.near(&[*from, *to]), survey.near(&[middle]));
        let gap = angle(*from, *to).to_degrees();
        table.row([
            scene.into(),
            format!("{a}, {b}").into(),
            Some(Figure::exact(gap)).into(),
            ends.into(),
            midway.into(),
            difference(ends, midway).into(),
        ]);
    }
}

/// States the paper's two claims, in figures.
fn claims(one: &Surveyed, all: &Surveyed) -> String {
    let peak = |survey: &Surveyed| {
        let (near, far) = (
            survey.within(0.0..15.0).psnr,
            survey.within(45.0..180.0).psnr,
        );
        difference(near, far)
    };
    let drops = all.neighbours();
    let drops = drops.iter().filter_map(|&Neighbours { i, j, middle }| {
        let ends = all.near(&[all.trained[i].1, all.trained[j].1])?;
        Some(ends.mean - all.near(&[middle])?.mean)
    });
    let drops: Vec<f64> = drops.collect();
    let valleys = match drops.iter().copied().reduce(f64::min) {
        None => "no pair of neighbours has viewpoints at it and midway".to_owned(),
        Some(least) => {
            let greatest = drops.iter().copied().fold(least, f64::max);
            let n = drops.len();
            format!("{least:+.2} to {greatest:+.2} dB less midway between {n} pairs of neighbours")
        }
    };
    format!(
        "peaks: PSNR within 15 degrees of a camera is {} dB above that beyond 45 with one camera \
         and {} dB with all {}. Valleys: {valleys}.",
        peak(one),
        peak(all),
        all.trained.len()
    )
}
