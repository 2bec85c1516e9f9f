//! Plots: what is drawn, what is refused.

use glam::DVec3;
use gspotential::camera::compass::Compass;
use gspotential::report::plot::{Axis, MapMark, Plot, Point, SphereMap, Style};

fn curve(points: &[(f64, f64)]) -> Vec<Point> {
    points.iter().map(|&(x, y)| Point::new(x, y)).collect()
}

/// Texts of the document, in order.
fn texts(svg: &str) -> Vec<&str> {
    let parts = svg.split("<text").skip(1);
    let inner = parts.filter_map(|part| part.split_once('>')?.1.split_once("</text>"));
    inner.map(|(text, _)| text.trim()).collect()
}

#[test]
fn labels_title_and_legend_are_written() {
    let svg = Plot::new("Quality", Axis::log("Gaussians"), Axis::linear("PSNR (dB)"))
        .with("3dgs", Style::Curve, curve(&[(1e3, 15.0), (1e5, 18.5)]))
        .with("paper", Style::Curve, curve(&[(1e3, 16.0), (1e5, 19.5)]))
        .to_svg()
        .unwrap();
    let texts = texts(&svg);
    for expected in [
        "Quality",
        "Gaussians",
        "PSNR (dB)",
        "3dgs",
        "paper",
        "1000",
        "10000",
        "16",
        "19",
    ] {
        assert!(
            texts.contains(&expected),
            "{expected} is not among {texts:?}"
        );
    }
    assert!(svg.contains("<polyline"));
}

#[test]
fn names_from_files_are_escaped() {
    let name = "<script>&\"'";
    let svg = Plot::new(name, Axis::linear(name), Axis::linear(name))
        .with(name, Style::Marks, curve(&[(1.0, 2.0), (2.0, 1.0)]))
        .to_svg()
        .unwrap();
    assert!(!svg.contains("<script>"), "{svg}");
    assert!(svg.contains("&lt;script&gt;&amp;"), "{svg}");
}

#[test]
fn categories_stand_at_their_numbers() {
    let names = vec!["alpha".to_owned(), "beta".to_owned()];
    let with_spread = Point {
        x: 1.0,
        y: 3.0,
        spread: Some(0.5),
    };
    let svg = Plot::new("", Axis::categories("row", names), Axis::linear("dB"))
        .with("", Style::Marks, vec![Point::new(0.0, 1.0), with_spread])
        .to_svg()
        .unwrap();
    let texts = texts(&svg);
    assert!(
        texts.contains(&"alpha") && texts.contains(&"beta"),
        "{texts:?}"
    );
    // The range makes room for the error bar.
    assert!(texts.contains(&"3.5"), "{texts:?}");
}

#[test]
fn what_an_axis_cannot_show_is_left_out() {
    let points = curve(&[
        (0.0, 1.0),
        (f64::NAN, 1.0),
        (10.0, f64::INFINITY),
        (10.0, 1.0),
    ]);
    let plot = Plot::new("t", Axis::log("x"), Axis::linear("y"));
    let svg = plot
        .clone()
        .with("", Style::Marks, points)
        .to_svg()
        .unwrap();
    assert_eq!(svg.matches("<circle").count(), 1);
    let error = plot
        .with("", Style::Marks, curve(&[(-1.0, 1.0)]))
        .to_svg()
        .unwrap_err();
    assert!(error.to_string().contains("no point"), "{error}");
}

#[test]
fn colours_need_a_value_a_point() {
    let plot = Plot::new("t", Axis::linear("x"), Axis::linear("y"));
    let points = curve(&[(0.0, 1.0), (1.0, 2.0)]);
    let mut colored = plot
        .clone()
        .with("", Style::Colored(vec![0.0, 90.0]), points.clone());
    colored.color_label = "angle (degrees)".to_owned();
    let svg = colored.to_svg().unwrap();
    assert!(texts(&svg).contains(&"angle (degrees)"));
    let fills: Vec<&str> = svg
        .split("<circle")
        .skip(1)
        .filter_map(|circle| circle.split_once("fill=\"")?.1.get(..7))
        .collect();
    // Viridis begins in dark purple.
    assert_eq!(fills.len(), 2);
    assert_eq!(fills[0], "#440154");
    assert_ne!(fills[0], fills[1]);
    assert!(
        plot.with("", Style::Colored(vec![0.0]), points)
            .to_svg()
            .is_err()
    );
}

#[test]
fn a_map_shows_values_and_marks() {
    let value = |p: DVec3| p.z;
    let mut map = SphereMap {
        title: "U_info".to_owned(),
        color_label: "U_info".to_owned(),
        range: None,
        value: &value,
        compass: Compass::new(DVec3::Z, DVec3::X).unwrap(),
        marks: vec![MapMark {
            name: "training".to_owned(),
            directions: vec![DVec3::X, DVec3::Z],
            color: [255, 0, 0],
            size_px: 5,
        }],
    };
    let svg = map.to_svg().unwrap();
    assert!(texts(&svg).contains(&"training (2)"));
    // Two marks and the legend, each with its rim.
    assert_eq!(svg.matches("<circle").count(), 6);
    // What has one colour is one shape a row.
    map.value = &|_| 1.0;
    let rows = map.to_svg().unwrap().matches(r#"width="720""#).count();
    assert_eq!(rows, 60);
    // A given range fixes the colours, and what has no value is left blank.
    map.range = Some(-1.0..1.0);
    let middle = map.to_svg().unwrap();
    map.range = Some(1.0..2.0);
    assert_ne!(map.to_svg().unwrap(), middle);
    map.value = &|p| if p.z > 0.0 { 1.0 } else { f64::NAN };
    let svg = map.to_svg().unwrap();
    let blank = svg.matches(r##"fill="#FFFFFF""##).count();
    assert!(blank >= 30, "{blank}");
    map.value = &|_| f64::NAN;
    assert!(map.to_svg().is_err());
}

/// `GSPOTENTIAL_PLOTS=DIR` keeps examples to look at.
#[test]
fn examples_are_complete_documents() {
    let kept = std::env::var_os("GSPOTENTIAL_PLOTS").map(std::path::PathBuf::from);
    let temporary = tempfile::tempdir().unwrap();
    let folder = kept.as_deref().unwrap_or(temporary.path());
    let with_spread = |x, y| Point {
        x,
        y,
        spread: Some(0.4),
    };
    let plot = Plot::new(
        "PSNR against Gaussians, 320 px",
        Axis::log("Gaussians"),
        Axis::linear("PSNR (dB)"),
    )
    .with(
        "3dgs",
        Style::Curve,
        vec![with_spread(4e3, 14.0), with_spread(6e4, 15.5)],
    )
    .with("paper", Style::Curve, curve(&[(4e3, 15.0), (6e4, 17.0)]));
    plot.write(&folder.join("curve.svg")).unwrap();
    let value = |p: DVec3| p.z + 0.3 * p.x;
    let mark = |name: &str, color, d: DVec3| MapMark {
        name: name.to_owned(),
        directions: vec![d],
        color,
        size_px: 4,
    };
    let map = SphereMap {
        title: "U_total".to_owned(),
        color_label: "U_total".to_owned(),
        range: None,
        value: &value,
        compass: Compass::new(DVec3::Z, DVec3::X).unwrap(),
        marks: vec![
            mark("training", [230, 30, 30], DVec3::X),
            mark("virtual", [255, 255, 255], DVec3::new(0.6, 0.0, 0.8)),
            mark("test", [80, 160, 255], DVec3::NEG_Y),
        ],
    };
    map.write(&folder.join("map.svg")).unwrap();
    let mut colored = Plot::new("c", Axis::linear("potential"), Axis::linear("PSNR (dB)")).with(
        "",
        Style::Colored(vec![3.0, 40.0, 80.0]),
        curve(&[(0.1, 14.0), (0.5, 17.0), (0.9, 18.0)]),
    );
    colored.color_label = "angle (deg)".to_owned();
    colored.write(&folder.join("colored.svg")).unwrap();
    for name in ["curve", "map", "colored"] {
        let svg = std::fs::read_to_string(folder.join(format!("{name}.svg"))).unwrap();
        assert!(
            svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"),
            "{name}"
        );
    }
}
