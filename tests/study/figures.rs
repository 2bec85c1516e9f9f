//! Means, deviations, rank correlation, and the tables that show them.

use glam::DVec3;
use gspotential::report::stats::{Figure, partial_spearman, spearman};
use gspotential::report::{Cell, Column, Table};
use gspotential::scene::builtin::{test_cameras, train_cameras};
use gspotential::study::{Place, below, front, spread_order};

fn figure(values: &[f64]) -> Option<Figure> {
    Figure::of(values.iter().copied().map(Some))
}

#[test]
fn spearman_is_known_from_textbooks_with_and_without_ties() {
    // Intelligence quotient against hours of television: -29/165.
    let iq = [106., 100., 86., 101., 99., 103., 97., 113., 112., 110.];
    let hours = [7., 27., 2., 50., 28., 29., 20., 12., 6., 17.];
    let pairs: Vec<(f64, f64)> = iq.into_iter().zip(hours).collect();
    let rho = spearman(&pairs).expect("an order");
    assert!((rho + 29.0 / 165.0).abs() < 1e-14, "{rho}");
    // Any monotone scale ranks alike.
    let bent: Vec<(f64, f64)> = pairs.iter().map(|(x, y)| (x.exp(), -y.powi(3))).collect();
    assert!((spearman(&bent).expect("an order") + rho).abs() < 1e-14);
    // Ranks 1, 2.5, 2.5, 4 against 1 to 4: 4.5 / sqrt(4.5 * 5).
    let tied = [(1.0, 1.0), (2.0, 2.0), (2.0, 3.0), (3.0, 4.0)];
    let rho = spearman(&tied).expect("an order");
    assert!((rho - 0.9f64.sqrt()).abs() < 1e-14, "{rho}");
    // Infinities rank at the ends; what has no order has no correlation.
    let ends = [(1.0, f64::INFINITY), (2.0, 5.0), (3.0, f64::NEG_INFINITY)];
    assert_eq!(spearman(&ends), Some(-1.0));
    for pairs in [
        &[][..],
        &[(1.0, 2.0)],
        &[(1.0, 1.0), (1.0, 2.0)],
        &[(1.0, f64::NAN), (2.0, 0.0)],
    ] {
        assert_eq!(spearman(pairs), None, "{pairs:?}");
    }
}

#[test]
fn partial_spearman_takes_out_what_a_third_ranking_explains() {
    // Rank correlations 0.6, 0.8 and 0: (0.6 - 0) / sqrt(0.36).
    let (x, y, z) = ([1., 2., 3., 4.], [2., 1., 4., 3.], [1., 3., 2., 4.]);
    let rho = partial_spearman(&x, &y, &z).expect("an order");
    assert!((rho - 1.0).abs() < 1e-12, "{rho}");
    let rho = partial_spearman(&y, &z, &x).expect("an order");
    assert!(
        (rho + 0.48 / (0.64f64 * 0.36).sqrt()).abs() < 1e-12,
        "{rho}"
    );
    // What the third ranks alike has nothing left.
    assert_eq!(partial_spearman(&x, &y, &x), None);
}

#[test]
fn a_figure_is_a_mean_and_a_sample_standard_deviation() {
    let of_four = figure(&[2.0, 4.0, 4.0, 6.0]).expect("values");
    assert_eq!(of_four.mean, 4.0);
    assert!((of_four.deviation.expect("several") - (8.0f64 / 3.0).sqrt()).abs() < 1e-15);
    assert_eq!(figure(&[5.0]), Some(Figure::exact(5.0)));
    assert_eq!(figure(&[]), None);
}

#[test]
fn a_difference_inside_the_spread_is_noise_and_one_seed_cannot_tell() {
    let about = |mean, deviation| Figure { mean, deviation };
    let base = about(10.0, Some(0.3));
    // sqrt(0.3^2 + 0.4^2) = 0.5.
    for (mean, expected) in [(10.49, true), (10.51, false), (9.49, false), (9.51, true)] {
        let other = about(mean, Some(0.4));
        assert_eq!(other.is_within_noise_of(&base), Some(expected), "{mean}");
        assert_eq!(base.is_within_noise_of(&other), Some(expected), "{mean}");
    }
    assert_eq!(Figure::exact(10.0).is_within_noise_of(&base), None);
}

#[test]
fn a_table_says_the_same_as_markdown_csv_and_json() {
    let columns = [
        Column::text("name", "what"),
        Column::figure("psnr", "PSNR dB", 2),
    ];
    let mut table = Table::new("some", &columns);
    table.row(["a, \"b\" | c".into(), figure(&[16.0, 17.0]).into()]);
    table.row(["one".into(), Some(Figure::exact(16.126)).into()]);
    table.row(["none".into(), Cell::Figure(None)]);
    let markdown = table.to_string();
    let lines: Vec<&str> = markdown.lines().collect();
    assert!(lines[0].contains("| what") && lines[0].contains("PSNR dB |"));
    assert!(lines[2].contains("a, \"b\" \\| c") && lines[2].ends_with(" 16.50 ± 0.71 |"));
    assert!(lines[3].ends_with(" 16.13 |") && lines[4].ends_with(" n/a |"));
    assert_eq!(
        table.to_csv().expect("text"),
        "name,psnr,psnr_deviation\n\"a, \"\"b\"\" | c\",16.5,0.7071067811865476\none,16.126,\nnone,,\n"
    );
    assert_eq!(
        table.to_json(),
        serde_json::json!({"name": "some", "rows": [
            {"name": "a, \"b\" | c", "psnr": {"mean": 16.5, "deviation": 0.5f64.sqrt()}},
            {"name": "one", "psnr": {"mean": 16.126, "deviation": null}},
            {"name": "none", "psnr": null},
        ]})
    );
}

#[test]
fn more_training_views_are_the_scenes_own_and_then_those_farthest_apart() {
    let center = DVec3::new(0.0, 0.0, 0.3);
    let cameras = [train_cameras(64), test_cameras(64, 12)].concat();
    let order = spread_order(&cameras, 4, center);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..16).collect::<Vec<_>>());
    assert_eq!(order[0], 0);
    // Azimuths -112, -50, 36 and 154: that of 36 degrees is farthest from the first.
    assert_eq!(order[1], 2);
    assert!(order[..4].iter().all(|&i| i < 4), "{order:?}");
    // By brute force: no other view is farther from all before.
    let direction = |i: usize| (cameras[i].center() - center).normalize();
    let apart = |i: usize, before: &[usize]| {
        let cos = before.iter().map(|&j| direction(i).dot(direction(j)));
        cos.fold(f64::NEG_INFINITY, f64::max)
            .clamp(-1.0, 1.0)
            .acos()
    };
    for k in 4..16 {
        let best = (0..16)
            .filter(|i| !order[..k].contains(i))
            .map(|i| apart(i, &order[..k]))
            .fold(0.0, f64::max);
        assert!((apart(order[k], &order[..k]) - best).abs() < 1e-9, "{k}");
    }
}

#[test]
fn a_front_holds_what_no_other_beats() {
    let place = |variant: &str, cost: f64, quality: f64| Place {
        variant: variant.into(),
        cost,
        quality,
    };
    let places = [
        place("dear and worse", 9.0, 3.0),
        place("cheapest", 1.0, 1.0),
        place("best", 8.0, 5.0),
        place("as cheap, worse", 1.0, 0.5),
        place("as good, dearer", 2.0, 1.0),
        place("middle", 3.0, 4.0),
        place("twin of middle", 3.0, 4.0),
    ];
    assert_eq!(front(&places), [1, 5, 2]);
    assert_eq!(below(&places, &places[0]), 2.0);
    assert_eq!(below(&places, &places[5]), 0.0);
    assert_eq!(below(&places, &places[4]), 0.0);
    assert_eq!(front(&[]), Vec::<usize>::new());
}
