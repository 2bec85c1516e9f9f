//! LPIPS against published values and a naive f64 implementation.

use std::path::{Path, PathBuf};

use gspotential::error::Error;
use gspotential::metrics::lpips::{InputRange, Net};
use gspotential::metrics::{FloatImage, Lpips};
use gspotential::scene::Image;

use super::lpips_reference::{ALEX, Tensors, VGG, generated, reference};
use super::noise;
use crate::kit::data::shared;

/// f32 against f64, relative.
const TOLERANCE: f64 = 2e-6;

/// The LPIPS package's own example: its weights and images.
fn example() -> (PathBuf, [Image; 3]) {
    let folder = shared("lpips");
    let images = ["ex_ref.png", "ex_p0.png", "ex_p1.png"].map(|name| {
        let image = image::open(folder.join(name)).expect(name).into_rgb8();
        Image {
            width: image.width(),
            height: image.height(),
            rgb: image.into_raw(),
        }
    });
    (folder.join("lpips_alex.safetensors"), images)
}

#[test]
#[ignore = "needs ../shared/lpips"]
fn alexnet_gives_the_published_distances() {
    let (weights, [truth, p0, p1]) = example();
    let signed = Lpips::read(&weights, InputRange::Signed).unwrap();
    assert_eq!((signed.net(), signed.min_side_px()), (Net::Alex, 31));
    let near = |ours: f64, golden: f64| assert!((ours - golden).abs() < 1e-5, "{ours}, {golden}");
    near(signed.distance(&p0, &truth).unwrap(), 0.721_881);
    near(signed.distance(&p1, &truth).unwrap(), 0.137_566);
    // As 3DGS feeds it: half a percent more, and 1.6 % less.
    let unit = Lpips::read(&weights, InputRange::Unit).unwrap();
    let share = |image: &Image, golden: f64| unit.distance(image, &truth).unwrap() / golden - 1.0;
    assert!((share(&p0, 0.721_881) - 0.005).abs() < 5e-4);
    assert!((share(&p1, 0.137_566) + 0.016).abs() < 5e-4);
}

#[test]
fn both_nets_agree_with_naive_convolutions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    for (net, spec, sizes) in [
        (Net::Alex, ALEX, [(31, 31), (45, 38), (100, 67)]),
        (Net::Vgg, VGG, [(16, 16), (19, 33), (50, 30)]),
    ] {
        let tensors = generated(spec);
        std::fs::write(&path, tensors.bytes()).unwrap();
        for range in [InputRange::Unit, InputRange::Signed] {
            let lpips = Lpips::read(&path, range).unwrap();
            assert_eq!(lpips.net(), net);
            for (width, height) in sizes {
                let (a, b) = (noise(width, height, 1), noise(width, height, 2));
                let ours = lpips.distance(&a, &b).unwrap();
                let naive = reference(spec, &tensors, range == InputRange::Signed, &a, &b);
                eprintln!(
                    "{net} {range} {width}x{height}: {naive:.6}, off by {:.1e}",
                    ours / naive - 1.0
                );
                assert!(
                    (ours / naive - 1.0).abs() < TOLERANCE,
                    "{net} {range} {width}x{height}: {ours} and {naive}"
                );
            }
        }
    }
}

#[test]
fn comparison_with_naive_convolutions_notices_one_altered_value() {
    let (a, b) = (noise(33, 31, 1), noise(33, 31, 2));
    let mut tensors = generated(ALEX);
    let naive = reference(ALEX, &tensors, false, &a, &b);
    for name in [
        "net.slice1.0.weight",
        "net.slice2.3.bias",
        "net.slice5.10.weight",
        "lin0.model.1.weight",
    ] {
        let (before, values) = (tensors.clone(), tensors.values_mut(name));
        // The middle of a 3x3 kernel: of the last maps' one pixel, the others see the border.
        let at = values.len() / 2 + 4;
        values[at] += 0.3;
        let ours = read(&tensors).unwrap().distance(&a, &b).unwrap();
        assert!(
            (ours / naive - 1.0).abs() > 3.0 * TOLERANCE,
            "{name}: {ours}, {naive}"
        );
        tensors = before;
    }
}

/// Reads them back as the program does.
fn read(tensors: &Tensors) -> Result<Lpips, Error> {
    read_bytes(&tensors.bytes())
}

fn read_bytes(bytes: &[u8]) -> Result<Lpips, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    std::fs::write(&path, bytes).unwrap();
    Lpips::read(&path, InputRange::Unit)
}

#[test]
fn identical_images_are_at_no_distance_and_order_does_not_matter() {
    let lpips = read(&generated(ALEX)).unwrap();
    let (a, b) = (noise(40, 50, 3), noise(40, 50, 4));
    assert_eq!(lpips.distance(&a, &a).unwrap(), 0.0);
    let (ab, ba) = (
        lpips.distance(&a, &b).unwrap(),
        lpips.distance(&b, &a).unwrap(),
    );
    assert!(ab > 0.01 && ab == ba, "{ab} {ba}");
    // Black images have no features to scale to unit length where biases leave none.
    let black = Image {
        rgb: vec![0; a.rgb.len()],
        ..a.clone()
    };
    assert!(lpips.distance(&black, &a).unwrap().is_finite());
}

#[test]
fn masked_lpips_is_that_of_the_images_blackened_beyond_the_mask() {
    let lpips = read(&generated(ALEX)).unwrap();
    let (a, b) = (noise(40, 36, 3), noise(40, 36, 4));
    let mask: Vec<bool> = (0..40 * 36).map(|i| i % 40 < 25 && i / 40 > 9).collect();
    let blackened = |image: &Image| Image {
        rgb: (0..image.rgb.len())
            .map(|i| if mask[i / 3] { image.rgb[i] } else { 0 })
            .collect(),
        ..image.clone()
    };
    let masked = lpips.masked_distance(&a, &b, &mask).unwrap();
    let expected = lpips.distance(&blackened(&a), &blackened(&b)).unwrap();
    assert_eq!(masked, Some(expected));
    assert_ne!(expected, lpips.distance(&a, &b).unwrap());
    let none = vec![false; mask.len()];
    assert_eq!(lpips.masked_distance(&a, &b, &none).unwrap(), None);
    assert!(lpips.masked_distance(&a, &b, &none[1..]).is_err());
}

#[test]
fn float_renders_are_measured_as_they_are() {
    let lpips = read(&generated(ALEX)).unwrap();
    let (a, b) = (noise(32, 32, 3), noise(32, 32, 4));
    let floats = |offset: f32| -> Vec<f32> {
        let values = a.rgb.iter().map(|&v| (f32::from(v) + offset) / 255.0);
        values.collect()
    };
    let with = |rgb: &[f32]| {
        let render = FloatImage {
            width: 32,
            height: 32,
            rgb,
        };
        lpips.distance(&render, &b).unwrap()
    };
    let rounded = lpips.distance(&a, &b).unwrap();
    assert!((with(&floats(0.0)) / rounded - 1.0).abs() < 1e-6);
    // Less than a rounding step is seen.
    assert!((with(&floats(0.4)) / rounded - 1.0).abs() > 1e-5);
}

#[test]
fn lpips_has_the_same_bits_whatever_the_number_of_threads() {
    let lpips = read(&generated(ALEX)).unwrap();
    let (a, b) = (noise(150, 120, 3), noise(150, 120, 4));
    let with = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build();
        let distance = pool.unwrap().install(|| lpips.distance(&a, &b).unwrap());
        distance.to_bits()
    };
    let one = with(1);
    assert!([2, 3, 7].into_iter().all(|n| with(n) == one));
}

#[test]
fn images_that_the_net_leaves_nothing_of_are_refused() {
    for (spec, least) in [(ALEX, 31), (VGG, 16)] {
        let lpips = read(&generated(spec)).unwrap();
        assert_eq!(lpips.min_side_px(), least);
        let fits = noise(least, least, 1);
        assert!(lpips.distance(&fits, &fits).is_ok());
        for (width, height) in [(least - 1, 100), (100, least - 1), (1, 1)] {
            let small = noise(width, height, 1);
            let error = lpips.distance(&small, &small).unwrap_err().to_string();
            assert!(error.contains(&format!("{least} pixels a side")), "{error}");
        }
    }
}

/// Asserts a one-line error that names all of `parts`, the file and a way out.
#[track_caller]
fn assert_refused(bytes: &[u8], parts: &[&str]) {
    let error = read_bytes(bytes).expect_err("an error").to_string();
    for part in parts.iter().chain(&["weights.safetensors", "; "]) {
        assert!(error.contains(part), "no `{part}` in: {error}");
    }
    assert!(error.len() < 1000 && !error.contains('\n'), "{error}");
}

#[test]
fn faulty_tensors_are_named() {
    let good = generated(ALEX);
    for name in [
        "net.slice4.8.weight",
        "net.slice1.0.bias",
        "lin4.model.1.weight",
    ] {
        assert_refused(
            &good.without(name).bytes(),
            &[&format!("tensor `{name}`"), "missing"],
        );
        for value in [f32::NAN, f32::INFINITY] {
            let mut damaged = good.clone();
            *damaged.values_mut(name).last_mut().unwrap() = value;
            assert_refused(
                &damaged.bytes(),
                &[&format!("tensor `{name}`"), &value.to_string()],
            );
        }
    }
    let mut reshaped = good.clone();
    reshaped.shape_mut("net.slice3.6.weight").swap(0, 1);
    assert_refused(
        &reshaped.bytes(),
        &[
            "tensor `net.slice3.6.weight`",
            "[192, 384, 3, 3]",
            "[384, 192, 3, 3]",
        ],
    );
    let mut scaled = good.clone();
    scaled.values_mut("scaling_layer.scale")[1] = 1.0;
    assert_refused(&scaled.bytes(), &["tensor `scaling_layer.scale`", "0.448"]);
    let halves = good.bytes_with_type("net.slice2.3.bias", safetensors::Dtype::F16);
    assert_refused(&halves, &["tensor `net.slice2.3.bias`", "F16"]);
    // Another net's weights under the names of this one, and a net that is neither.
    let mut mislabelled = good.clone();
    let vgg = generated(VGG);
    let (name, other) = ("net.slice5.10.weight", "net.slice5.28.weight");
    *mislabelled.shape_mut(name) = vgg.shape(other).to_vec();
    *mislabelled.values_mut(name) = vgg.values(other).to_vec();
    assert_refused(
        &mislabelled.bytes(),
        &[&format!("tensor `{name}`"), "[512, 512, 3, 3]"],
    );
    let heads = good.only(|name| name.starts_with("lin"));
    assert_refused(&heads.bytes(), &["neither AlexNet nor VGG16"]);
}

#[test]
fn files_that_are_not_whole_are_refused_without_allocating_what_they_claim() {
    let good = generated(ALEX).bytes();
    let mut huge_header = good.clone();
    huge_header[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let claim = |header: &str| {
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header.as_bytes());
        bytes
    };
    let huge_tensor = claim(
        r#"{"net.slice5.10.weight": {"dtype": "F32", "shape": [1099511627776], "data_offsets": [0, 4398046511104]}}"#,
    );
    let overflow = claim(
        r#"{"a": {"dtype": "F32", "shape": [4294967296, 4294967296, 4], "data_offsets": [0, 0]}}"#,
    );
    for bytes in [
        &[][..],
        b"hello",
        &good[..7],
        &good[..500],
        &good[..good.len() - 1],
        &huge_header,
        &huge_tensor,
        &overflow,
        &claim("[1, 2"),
    ] {
        assert_refused(bytes, &["safetensors file"]);
    }
    // A folder, and where there are devices, one without an end.
    let folder = tempfile::tempdir().unwrap();
    assert!(Lpips::read(folder.path(), InputRange::Unit).is_err());
    let missing = folder.path().join("none");
    let error = Lpips::read(&missing, InputRange::Unit).unwrap_err();
    assert!(error.to_string().contains("none: cannot read"), "{error}");
    let zeros = Path::new("/dev/zero");
    if zeros.exists() {
        assert!(Lpips::read(zeros, InputRange::Unit).is_err());
    }
}
