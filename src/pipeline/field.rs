//! This module makes the field and the sampling of a scene alone.

use glam::DVec3;
use serde::Serialize;

use super::prepare::{carved, choose_views};
use super::{cameras, focus_of};
use crate::camera::compass::Compass;
use crate::cloud::agreement::Agreement;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::field::gaps::{Gaps, uncovered};
use crate::field::{Field, Focus, Outlook, angle};
use crate::report::plot::{MapMark, SphereMap};
use crate::scene::Scene;

const TRAINING_COLOR: [u8; 3] = [224, 60, 49];
const VIRTUAL_COLOR: [u8; 3] = [255, 255, 255];
const ADVICE_COLOR: [u8; 3] = [255, 0, 220];

/// The report of what a scene's photographs cover, `field.json`. Angles are degrees, by
/// [`Compass`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldReport {
    /// Short name of the scene.
    pub scene: String,
    /// Pseudo-focus, scene's own frame.
    pub focus: [f64; 3],
    /// Radius `R` of the sphere, scene's own unit.
    pub radius: f64,
    /// Unit vector that elevations are measured towards, scene's own frame.
    pub up: [f64; 3],
    /// The training cameras; their directions point from the focus to the optical centre.
    pub training: Vec<Place>,
    /// The virtual views, in the order of the draw.
    pub virtual_views: Vec<Place>,
    /// How much the training views leave uncovered.
    pub uncovered: Uncovered,
    /// The training cameras that have the focus behind them.
    pub looking_away: Vec<String>,
    /// `None` if the cameras look outward: places around the focus that look at it would not help.
    pub advice: Option<Advice>,
    /// How cloud and training views agree.
    pub agreement: Agreement,
}

/// A direction about the focus.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place {
    /// The camera's, where there is one.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Degrees about the up axis from the front, in (-180, 180].
    pub azimuth: f64,
    /// Degrees above the plane through the focus, -90 to 90.
    pub elevation: f64,
    /// `U_info`: how well training views inform this direction.
    pub u_info: f64,
    /// The nearest training camera; of a training camera the nearest other, null without one.
    pub nearest: Option<String>,
    /// Degrees to the nearest camera; null without one.
    pub nearest_angle: Option<f64>,
}

/// How much is uncovered within a band of elevations; shares in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Uncovered {
    /// The lowest and the highest elevation that count, degrees.
    pub elevations: [f64; 2],
    /// Mean of `max(0, 1 - U_info)` over the band.
    pub mean: f64,
    /// The least covered direction of the band.
    pub worst: Place,
    /// `max(0, 1 - U_info)` there.
    pub worst_value: f64,
}

/// The place of one more photograph that leaves the least uncovered.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// The advised direction.
    pub place: Place,
    /// On the sphere, in the scene's own frame, looking at the focus.
    pub position: [f64; 3],
    /// Mean over the band once this photograph is taken, in [0, 1].
    pub mean_uncovered: f64,
    /// Degrees from the nearest training camera to the right of someone there who looks at the
    /// focus.
    pub to_the_right: f64,
    /// Degrees of elevation above the nearest training camera.
    pub upwards: f64,
}

/// The field of a scene's training views, and its maps as SVG.
pub struct FieldMaps {
    /// The figures.
    pub report: FieldReport,
    /// `U_total` with the virtual views drawn from it.
    pub potential_svg: String,
    /// What is uncovered, with the advice.
    pub gaps_svg: String,
    /// Lines for the log.
    pub warnings: Vec<String>,
}

/// Makes the field of `scene` as `config` says, draws its virtual views and looks for gaps.
///
/// # Errors
/// A cloud that no training view sees, a camera layout without a sphere, or more virtual views than
/// candidates.
pub fn field(scene: &Scene, config: &Config) -> Result<FieldMaps> {
    let training = cameras(&scene.train);
    let agreement = Agreement::of(scene)?;
    let (focus, _) = focus_of(scene)?;
    let map = Surveyed {
        field: Field::new(&training, &focus, &config.field),
        compass: Compass::of_cameras(&training, focus.center)?,
        names: training.iter().map(|camera| camera.name.clone()).collect(),
    };
    let carved = carved(scene, &focus.frame(), config)?;
    let cloud = carved.as_ref().map_or(&scene.cloud, |c| &c.cloud);
    let views = choose_views(&training, (&focus, &map.field), cloud, config)
        .map_err(|e| agreement.explain(e))?;
    let gaps = Gaps::find(&map.field, &map.compass)
        .ok_or_else(|| Error::new("no training camera to look for gaps with"))?;
    let outlook = Outlook::of(&training, &focus);
    let advised = (!outlook.is_outward()).then_some(gaps.advice);
    let drawn: Vec<DVec3> = views.iter().map(|view| view.direction).collect();
    let report = FieldReport {
        scene: scene.name.clone(),
        focus: focus.center.to_array(),
        radius: focus.radius,
        up: map.compass.up().to_array(),
        training: map.training(),
        virtual_views: views
            .iter()
            .map(|view| map.place(&view.camera.name, view.direction))
            .collect(),
        uncovered: Uncovered {
            elevations: gaps.band,
            mean: gaps.mean,
            worst: map.place("", gaps.worst),
            worst_value: gaps.worst_value,
        },
        looking_away: outlook.away.iter().map(|i| map.names[*i].clone()).collect(),
        advice: advised.map(|_| map.advice(&gaps, &focus)),
        agreement,
    };
    Ok(FieldMaps {
        potential_svg: map.potential_svg(&drawn)?,
        gaps_svg: map.gaps_svg(advised)?,
        warnings: focus
            .fallback
            .into_iter()
            .chain(outlook.warning(&training))
            .chain(report.agreement.warnings.clone())
            .collect(),
        report,
    })
}

/// A field with the names of its cameras.
struct Surveyed {
    field: Field,
    compass: Compass,
    names: Vec<String>,
}

impl Surveyed {
    fn place(&self, name: &str, direction: DVec3) -> Place {
        let (azimuth, elevation) = self.compass.angles(direction);
        Place {
            name: name.to_owned(),
            azimuth,
            elevation,
            u_info: self.field.u_info(direction),
            nearest: Some(self.names[self.field.nearest(direction)].clone()),
            nearest_angle: Some(self.field.u_conf(direction).to_degrees()),
        }
    }

    fn training(&self) -> Vec<Place> {
        let directions = &self.field.directions;
        let place = |(i, direction): (usize, &DVec3)| {
            let others = (0..directions.len()).filter(|j| *j != i);
            let angles = others.map(|j| (angle(*direction, directions[j]), j));
            let nearest = angles.min_by(|a, b| a.0.total_cmp(&b.0));
            Place {
                nearest: nearest.map(|(_, j)| self.names[j].clone()),
                nearest_angle: nearest.map(|(radians, _)| radians.to_degrees()),
                ..self.place(&self.names[i], *direction)
            }
        };
        directions.iter().enumerate().map(place).collect()
    }

    fn advice(&self, gaps: &Gaps, focus: &Focus) -> Advice {
        let nearest = self.field.directions[self.field.nearest(gaps.advice)];
        let (from, to) = (
            self.compass.angles(nearest),
            self.compass.angles(gaps.advice),
        );
        Advice {
            place: self.place("", gaps.advice),
            position: (focus.center + focus.radius * gaps.advice).to_array(),
            mean_uncovered: gaps.mean_with_advice,
            to_the_right: (to.0 - from.0 + 540.0).rem_euclid(360.0) - 180.0,
            upwards: to.1 - from.1,
        }
    }

    fn potential_svg(&self, drawn: &[DVec3]) -> Result<String> {
        SphereMap {
            title: "Camera potential".to_owned(),
            color_label: "U_total".to_owned(),
            range: None,
            value: &|d| self.field.u_total(d),
            compass: self.compass,
            marks: vec![
                mark("virtual", drawn.to_vec(), VIRTUAL_COLOR, 2),
                self.training_mark(),
            ],
        }
        .to_svg()
    }

    fn gaps_svg(&self, advice: Option<DVec3>) -> Result<String> {
        let one_more = advice.map(|advice| mark("one more", vec![advice], ADVICE_COLOR, 6));
        SphereMap {
            title: "What the photographs leave uncovered".to_owned(),
            color_label: "uncovered".to_owned(),
            range: None,
            value: &|d| uncovered(&self.field, d),
            compass: self.compass,
            marks: [self.training_mark()].into_iter().chain(one_more).collect(),
        }
        .to_svg()
    }

    fn training_mark(&self) -> MapMark {
        mark("training", self.field.directions.clone(), TRAINING_COLOR, 5)
    }
}

fn mark(name: &str, directions: Vec<DVec3>, color: [u8; 3], size_px: u32) -> MapMark {
    MapMark {
        name: name.to_owned(),
        directions,
        color,
        size_px,
    }
}
