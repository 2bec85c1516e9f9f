//! Holes that photographs leave: the measure, the advice, and the command that prints them.

use glam::DVec3;
use gspotential::camera::compass::Compass;
use gspotential::config::Kernel;
use gspotential::field::gaps::{Gaps, uncovered};
use gspotential::field::{Field, fibonacci_sphere};

const SIGMA: f64 = 5.298292365610484;

fn compass() -> Compass {
    Compass::new(DVec3::Z, DVec3::X).unwrap()
}

/// Cameras at azimuths, all at one elevation.
fn ring(azimuths: &[f64], elevation: f64) -> Field {
    Field {
        directions: azimuths
            .iter()
            .map(|a| compass().direction(*a, elevation))
            .collect(),
        kernel: Kernel::Sech,
        sigma: SIGMA,
        lambda: 0.2,
    }
}

#[test]
fn a_photograph_covers_where_it_was_taken_and_nothing_opposite() {
    let field = ring(&[0.0], 0.0);
    assert_eq!(uncovered(&field, DVec3::X), 0.0);
    // sech(2 sigma) is 5e-5.
    assert!(uncovered(&field, DVec3::NEG_X) > 0.9999);
    let halfway = uncovered(&field, compass().direction(45.0, 0.0));
    let expected = 1.0 - 1.0 / (SIGMA * (1.0 - 0.5f64.sqrt())).cosh();
    assert!((halfway - expected).abs() < 1e-12);
}

/// Three of four places on a ring are taken: the fourth is what is missing.
#[test]
fn the_missing_camera_of_a_ring_is_advised() {
    let gaps = Gaps::find(&ring(&[0.0, 90.0, 180.0], 20.0), &compass()).unwrap();
    assert_eq!(gaps.band.map(|e| e.round()), [5.0, 35.0]);
    let (azimuth, elevation) = compass().angles(gaps.advice);
    assert!((azimuth + 90.0).abs() < 5.0, "{azimuth}");
    assert!((5.0..=35.0).contains(&elevation), "{elevation}");
    let (azimuth, _) = compass().angles(gaps.worst);
    assert!((azimuth + 90.0).abs() < 10.0, "{azimuth}");
    assert!(gaps.mean_with_advice < gaps.mean);
    // Were it taken, less would be uncovered, as much as was said.
    let taken = Field {
        directions: vec![gaps.advice],
        ..ring(&[], 0.0)
    };
    let mut with = ring(&[0.0, 90.0, 180.0], 20.0);
    with.directions.extend(&taken.directions);
    let within = |d: &DVec3| (gaps.band[0]..=gaps.band[1]).contains(&compass().angles(*d).1);
    let band: Vec<DVec3> = fibonacci_sphere(4096).into_iter().filter(within).collect();
    let mean =
        |field: &Field| band.iter().map(|d| uncovered(field, *d)).sum::<f64>() / band.len() as f64;
    assert!((mean(&with) - gaps.mean_with_advice).abs() < 1e-9);
    // And no other place leaves less.
    for other in band.iter().step_by(97) {
        with.directions[3] = *other;
        assert!(mean(&with) >= gaps.mean_with_advice - 1e-12);
    }
}

/// Wide kernels cover a ring of four but for a little on both sides of the second camera: beside
/// it one more would fill both and show nothing new.
#[test]
fn one_more_photograph_is_not_advised_beside_another() {
    let gaps = Gaps::find(&ring(&[0.0, 100.0, 200.0, 280.0], 30.0), &compass()).unwrap();
    let (azimuth, _) = compass().angles(gaps.advice);
    let nearest = [0.0, 100.0, 200.0, 280.0]
        .map(|a: f64| ((azimuth - a + 180.0).rem_euclid(360.0) - 180.0).abs())
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    assert!(nearest > 30.0, "{azimuth}");
}

#[test]
fn no_camera_has_no_gaps() {
    assert!(Gaps::find(&ring(&[], 0.0), &compass()).is_none());
}
