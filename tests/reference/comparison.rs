//! The comparisons and the readers can fail.

use gspotential::doctor::twin::compare::{max_abs_off_mask, relative_l2};
use gspotential::doctor::twin::random::Random;

use super::fixture::parse_ply;
use super::npy;
use super::{assert_close_off_mask, assert_relative_l2};

fn values(n: usize) -> Vec<f64> {
    let mut random = Random::new(3);
    (0..n).map(|_| random.uniform(-1.0, 1.0)).collect()
}

#[test]
fn relative_l2_sees_one_altered_element() {
    let b = values(3000);
    assert_eq!(relative_l2(&b, &b), 0.0);
    for (altered, expected) in [(1e-3, 1e-6), (f64::NAN, 1e300), (f64::INFINITY, 1e300)] {
        let mut a = b.clone();
        a[1234] += altered;
        assert!(relative_l2(&a, &b) > expected);
        assert!(relative_l2(&b, &a) > expected);
    }
    // The norm is the reference's: |(3, 4)| / |(0, 5)|, and absolute where that is 0.
    assert_eq!(relative_l2(&[3.0, 9.0], &[0.0, 5.0]), 1.0);
    assert_eq!(relative_l2(&[3.0, 4.0], &[0.0, 0.0]), 5.0);
}

#[test]
fn max_abs_sees_one_altered_element_unless_its_pixel_is_masked() {
    let b = values(3000);
    let mut mask = vec![false; 1000];
    mask[7] = true;
    assert_eq!(max_abs_off_mask(&b, &b, &mask), 0.0);
    for channel in 0..3 {
        for (altered, expected) in [(1e-3, 9e-4), (f64::NAN, 1e300), (f64::INFINITY, 1e300)] {
            let mut a = b.clone();
            a[8 * 3 + channel] += altered;
            assert!(max_abs_off_mask(&a, &b, &mask) > expected);
            assert!(max_abs_off_mask(&b, &a, &mask) > expected);
            a[8 * 3 + channel] = b[8 * 3 + channel];
            a[7 * 3 + channel] = altered;
            assert_eq!(max_abs_off_mask(&a, &b, &mask), 0.0);
        }
    }
}

#[test]
#[should_panic(expected = "gradient: relative L2")]
fn asserted_relative_l2_fails_on_one_altered_element() {
    let b = values(3000);
    let mut a = b.clone();
    a[0] += 1e-3;
    assert_relative_l2("gradient", &a, &b, 1e-6);
}

#[test]
#[should_panic(expected = "image: differs by")]
fn asserted_image_difference_fails_on_one_altered_element() {
    let b = values(3000);
    let mut a = b.clone();
    a[2999] += 1e-3;
    assert_close_off_mask("image", &a, &b, &[false; 1000], 1e-6);
}

#[test]
#[should_panic(expected = "differ in length")]
fn arrays_of_different_length_do_not_compare() {
    relative_l2(&[1.0, 2.0], &[1.0]);
}

fn npy_bytes(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend_from_slice(data);
    bytes
}

#[test]
fn npy_arrays_are_read_in_all_four_types_and_refused_when_truncated() {
    let f8: Vec<u8> = [0.1f64, -2.0]
        .into_iter()
        .flat_map(f64::to_le_bytes)
        .collect();
    let f4: Vec<u8> = [0.1f32, -2.0]
        .into_iter()
        .flat_map(f32::to_le_bytes)
        .collect();
    let cases: [(&str, &[u8], [f64; 2]); 4] = [
        ("<f8", &f8, [0.1, -2.0]),
        ("<f4", &f4, [f64::from(0.1f32), -2.0]),
        ("|u1", &[255, 1], [255.0, 1.0]),
        ("<u2", &[1, 2, 255, 0], [513.0, 255.0]),
    ];
    for (descr, data, expected) in cases {
        let array = npy::parse(&npy_bytes(descr, "(2, 1)", data)).expect(descr);
        assert_eq!(array.shape, [2, 1]);
        assert_eq!(array.values, expected);
        let flat = npy::parse(&npy_bytes(descr, "(2,)", data)).expect(descr);
        assert_eq!(flat.shape, [2]);
        let short = &data[..data.len() - 1];
        assert!(npy::parse(&npy_bytes(descr, "(2, 1)", short)).is_err());
        assert!(npy::parse(&npy_bytes(descr, "(3, 1)", data)).is_err());
    }
    assert!(npy::parse(&npy_bytes("<i4", "(2,)", &f4)).is_err());
    let fortran =
        String::from_utf8_lossy(&npy_bytes("|u1", "(0,)", &[])[10..]).replace("False", "True");
    let mut bytes = npy_bytes("|u1", "(0,)", &[])[..8].to_vec();
    bytes.extend_from_slice(&(fortran.len() as u16).to_le_bytes());
    bytes.extend_from_slice(fortran.as_bytes());
    assert_eq!(npy::parse(&bytes), Err("Fortran order".into()));
}

#[test]
fn gaussians_are_read_from_the_62_float_layout_alone() {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\nelement vertex 1\n");
    let names = ["x", "y", "z", "nx", "ny", "nz"]
        .map(String::from)
        .into_iter();
    let names = names.chain((0..3).map(|i| format!("f_dc_{i}")));
    let names = names.chain((0..45).map(|i| format!("f_rest_{i}")));
    let names = names.chain(["opacity".into()]);
    let names = names.chain((0..3).map(|i| format!("scale_{i}")));
    for name in names.chain((0..4).map(|i| format!("rot_{i}"))) {
        header += &format!("property float {name}\n");
    }
    let file = |header: &str, n_floats: u16| {
        let mut bytes = format!("{header}end_header\n").into_bytes();
        bytes.extend((0..n_floats).flat_map(|i| f32::from(i).to_le_bytes()));
        bytes
    };
    let gaussians = parse_ply(&file(&header, 62)).expect("the layout");
    assert_eq!(gaussians.means, [[0.0, 1.0, 2.0]]);
    assert_eq!(gaussians.sh[0][0], [6.0, 7.0, 8.0]);
    assert_eq!(gaussians.sh[0][1], [9.0, 24.0, 39.0]);
    assert_eq!(gaussians.sh[0][15], [23.0, 38.0, 53.0]);
    assert_eq!(gaussians.opacity_logit, [54.0]);
    assert_eq!(gaussians.scale_log, [[55.0, 56.0, 57.0]]);
    assert_eq!(gaussians.rotation_wxyz, [[58.0, 59.0, 60.0, 61.0]]);
    assert!(parse_ply(&file(&header, 61)).is_err());
    assert!(parse_ply(&file(&header.replace("rot_3", "rot_4"), 62)).is_err());
}
