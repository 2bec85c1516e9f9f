//! Gaussians on disk.

use std::path::Path;

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::Frame;
use gspotential::camera::json::read_cameras;
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::ply::{read_ply, write_ply};

use crate::geometry::{Random, scratch};
use crate::kit::data::shared;

pub(crate) fn distinct(n: usize, sh_degree: u32) -> Gaussians {
    let mut random = Random::new(u64::from(sh_degree));
    let mut value = || random.in_range(-3.0, 3.0) as f32;
    let n_sh = (sh_degree as usize + 1).pow(2);
    Gaussians {
        means: (0..n)
            .map(|_| Vec3::new(value(), value(), value()))
            .collect(),
        scales_log: (0..n)
            .map(|_| Vec3::new(value(), value(), value()))
            .collect(),
        rotations_wxyz: (0..n)
            .map(|_| [value(), value(), value(), value()])
            .collect(),
        opacity_logits: (0..n).map(|_| value()).collect(),
        sh: (0..n * n_sh * 3).map(|_| value()).collect(),
        sh_degree,
    }
}

/// A folder for the test's files, and a path in it.
#[test]
fn ply_round_trip_is_bit_exact_for_every_degree() {
    let (_folder, path) = scratch("point_cloud.ply");
    for sh_degree in 0..=3 {
        for n in [0, 1, 37] {
            let gaussians = distinct(n, sh_degree);
            write_ply(&path, &gaussians, &Frame::IDENTITY).unwrap();
            assert!(
                read_ply(&path).unwrap().gaussians == gaussians,
                "degree {sh_degree}, {n}"
            );
        }
    }
}

#[test]
fn ply_layout_is_that_of_3dgs() {
    let (_folder, path) = scratch("point_cloud.ply");
    let gaussians = distinct(2, 1);
    write_ply(&path, &gaussians, &Frame::IDENTITY).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 \
        f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 f_rest_7 f_rest_8 \
        opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let mut header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n".to_owned();
    for name in names.split_whitespace() {
        header += &format!("property float {name}\n");
    }
    header += "end_header\n";
    assert!(bytes.starts_with(header.as_bytes()));
    let row: Vec<f32> = bytes[header.len()..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .skip(26)
        .collect();
    assert_eq!(row.len(), 26);
    let sh = |k: usize, c: usize| gaussians.sh[12 + k * 3 + c];
    assert_eq!(row[..3], gaussians.means[1].to_array());
    assert_eq!(row[3..6], [0.0; 3]);
    assert_eq!(row[6..9], [sh(0, 0), sh(0, 1), sh(0, 2)]);
    assert_eq!(row[9..12], [sh(1, 0), sh(2, 0), sh(3, 0)]);
    assert_eq!(row[12..15], [sh(1, 1), sh(2, 1), sh(3, 1)]);
    assert_eq!(row[15..18], [sh(1, 2), sh(2, 2), sh(3, 2)]);
    assert_eq!(row[18], gaussians.opacity_logits[1]);
    assert_eq!(row[19..22], gaussians.scales_log[1].to_array());
    assert_eq!(row[22..], gaussians.rotations_wxyz[1]);
}

#[test]
fn ply_is_written_in_the_scenes_own_frame() {
    let (_folder, path) = scratch("point_cloud.ply");
    let frame = Frame {
        center: dvec3(10.0, -5.0, 2.5),
        radius: 4.0,
        extent: 4.0,
    };
    let gaussians = distinct(20, 0);
    write_ply(&path, &gaussians, &frame).unwrap();
    let world = read_ply(&path).unwrap().gaussians;
    for (mean, canonical) in world.means.iter().zip(&gaussians.means) {
        let expected = canonical.as_dvec3() * 4.0 + frame.center;
        assert!(mean.as_dvec3().distance(expected) < 1e-5);
    }
    for (scale, canonical) in world.scales_log.iter().zip(&gaussians.scales_log) {
        assert!((scale.x.exp() / canonical.x.exp() / 4.0 - 1.0).abs() < 1e-5);
    }
    assert_eq!(world.sh, gaussians.sh);
    assert_eq!(world.rotations_wxyz, gaussians.rotations_wxyz);
    let back = world.to_canonical(&frame);
    for (a, b) in back.means.iter().zip(&gaussians.means) {
        assert!(a.distance(*b) < 1e-6);
    }
    for (a, b) in back.scales_log.iter().zip(&gaussians.scales_log) {
        assert!(a.distance(*b) < 1e-6);
    }
}

#[test]
fn ply_properties_may_come_in_any_order_beside_others() {
    let (_folder, path) = scratch("other.ply");
    let mut header = "ply\r\nformat binary_little_endian 1.0\r\n\
        comment written 20260101123456789012345 by another\r\nelement vertex 1\r\n\
        property uchar red\r\nproperty double time\r\n"
        .to_owned();
    let names =
        "rot_3 rot_2 rot_1 rot_0 z y x scale_2 scale_1 scale_0 opacity f_dc_2 f_dc_1 f_dc_0";
    for name in names.split_whitespace() {
        header += &format!("property float {name}\r\n");
    }
    header += "element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n";
    let mut bytes = header.into_bytes();
    bytes.extend([7; 9]);
    for value in 1..=14u8 {
        bytes.extend(f32::from(value).to_le_bytes());
    }
    bytes.push(0);
    std::fs::write(&path, bytes).unwrap();
    let gaussians = read_ply(&path).unwrap().gaussians;
    assert_eq!(gaussians.rotations_wxyz, [[4.0, 3.0, 2.0, 1.0]]);
    assert_eq!(gaussians.means, [Vec3::new(7.0, 6.0, 5.0)]);
    assert_eq!(gaussians.scales_log, [Vec3::new(10.0, 9.0, 8.0)]);
    assert_eq!(gaussians.opacity_logits, [11.0]);
    assert_eq!(gaussians.sh, [14.0, 13.0, 12.0]);
    assert_eq!(gaussians.sh_degree, 0);
}

#[test]
fn mip_splattings_filter_widens_scales_and_thins_opacities() {
    let (_folder, path) = scratch("point_cloud.ply");
    let plain = distinct(5, 0);
    write_ply(&path, &plain, &Frame::IDENTITY).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let start = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let row_bytes = (bytes.len() - start) / 5;
    let filters = [0.0f32, 0.05, 2.0, f32::NAN, 1e-6];
    let header = String::from_utf8(bytes[..start].to_vec()).unwrap();
    let mut file = header
        .replace("end_header", "property float filter_3D\nend_header")
        .into_bytes();
    for (row, filter) in bytes[start..].chunks(row_bytes).zip(filters) {
        file.extend(row);
        file.extend(filter.to_le_bytes());
    }
    std::fs::write(&path, file).unwrap();
    let read = read_ply(&path).unwrap().gaussians;
    for (i, filter) in filters.into_iter().enumerate() {
        let (scale, logit) = (plain.scales_log[i], plain.opacity_logits[i]);
        if i == 0 || filter.is_nan() {
            assert_eq!((read.scales_log[i], read.opacity_logits[i]), (scale, logit));
            continue;
        }
        let own = scale.to_array().map(|s| f64::from(s).exp());
        let wide = own.map(|s| s.hypot(f64::from(filter)));
        let found = read.scales_log[i].to_array().map(|s| f64::from(s).exp());
        let near = |(a, b): (f64, f64)| (a / b - 1.0).abs() < 1e-6;
        assert!(found.into_iter().zip(wide).all(near), "{found:?} {wide:?}");
        let opacity = |logit: f32| 1.0 / (1.0 + (-f64::from(logit)).exp());
        let share: f64 = own.iter().zip(wide).map(|(a, b)| a / b).product();
        let found = opacity(read.opacity_logits[i]);
        assert!(
            (found / (opacity(logit) * share) - 1.0).abs() < 1e-5,
            "{found}"
        );
    }
}

/// The error of reading these bytes as Gaussians, which must name the file and take one line.
fn ply_error(bytes: &[u8]) -> String {
    let (_folder, path) = scratch("bad.ply");
    std::fs::write(&path, bytes).unwrap();
    let text = read_ply(&path).unwrap_err().to_string();
    assert!(text.starts_with(&path.display().to_string()), "{text}");
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn truncated_ply_names_the_byte() {
    let (_folder, path) = scratch("point_cloud.ply");
    write_ply(&path, &distinct(5, 1), &Frame::IDENTITY).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let data = whole.len() - 5 * 26 * 4;
    for cut in [1, 104, 105, 5 * 104] {
        let text = ply_error(&whole[..whole.len() - cut]);
        let vertex = (5 * 104 - cut) / 104;
        assert!(
            text.contains(&format!("ends at byte {}", whole.len() - cut)),
            "{text}"
        );
        assert!(
            text.contains(&format!("within vertex {vertex} of the 5")),
            "{text}"
        );
    }
    // Cut anywhere in the header, it is an error too.
    for cut in 0..data {
        ply_error(&whole[..cut]);
    }
}

#[test]
fn a_huge_vertex_count_is_an_error_of_its_own() {
    let (_folder, path) = scratch("point_cloud.ply");
    write_ply(&path, &distinct(1, 0), &Frame::IDENTITY).unwrap();
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    let header = &text[..text.find("end_header\n").unwrap() + 11];
    for (count, expected) in [
        ("4000000000", "of the 4000000000"),
        (
            "1000000000000",
            "line 3: element `vertex` has no valid count",
        ),
        ("18446744073709551615", "no valid count below 2^32"),
        ("99999999999999999999999999", "no valid count below 2^32"),
        ("-1", "no valid count"),
        ("1e3", "no valid count"),
    ] {
        let header = header.replace("vertex 1\n", &format!("vertex {count}\n"));
        let text = ply_error(header.as_bytes());
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn ply_errors_name_what_is_missing_or_wrong() {
    let (_folder, path) = scratch("point_cloud.ply");
    write_ply(&path, &distinct(1, 1), &Frame::IDENTITY).unwrap();
    let whole = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    let replaced = |from: &str, to: &str| {
        assert!(whole.contains(from));
        ply_error(whole.replace(from, to).as_bytes())
    };
    for (from, to, expected) in [
        ("property float rot_2\n", "", "no property `rot_2`"),
        (
            "property float opacity\n",
            "property double opacity\n",
            "`opacity` is Double",
        ),
        (
            "property float y\n",
            "property list uchar float y\n",
            "`y` is a list",
        ),
        ("property float f_rest_4\n", "", "8 f_rest properties"),
        ("f_rest_4\n", "f_rest_9\n", "no property `f_rest_4`"),
        (
            "property float y\n",
            "property float x\n",
            "line 5: property `x` appears twice",
        ),
        (
            "binary_little_endian",
            "binary_big_endian",
            "encoding is binary_big_endian",
        ),
        ("binary_little_endian", "ascii", "encoding is ascii"),
        (
            "element vertex",
            "element face",
            "first element is not `vertex`",
        ),
        ("ply\n", "plyx\n", "bad PLY header"),
        ("ply\n", "hello\n", "not a PLY file"),
        ("end_header\n", "", "no `end_header`"),
        ("property float y\n", "property half y\n", "bad PLY header"),
    ] {
        let text = replaced(from, to);
        assert!(text.contains(expected), "{from:?} -> {to:?}: {text}");
    }
    assert!(ply_error(b"").contains("not a PLY file"));
    let missing = read_ply(Path::new("no/such.ply")).unwrap_err().to_string();
    assert!(missing.starts_with("no/such.ply: cannot read"), "{missing}");
}

#[test]
#[ignore = "needs ../shared/fixtures"]
fn reference_files_read_as_their_readme_says() {
    let folder = shared("fixtures");
    for (case, n, n_cameras) in [
        ("garden", 2933, 3),
        ("random", 1990, 2),
        ("huge", 1, 2),
        ("near", 300, 3),
    ] {
        let gaussians = read_ply(&folder.join(case).join("gaussians.ply"))
            .unwrap()
            .gaussians;
        assert_eq!((gaussians.len(), gaussians.sh_degree), (n, 3), "{case}");
        // Rows are 62 floats from the end of the file; compare the last one.
        let bytes = std::fs::read(folder.join(case).join("gaussians.ply")).unwrap();
        let row: Vec<f32> = bytes[bytes.len() - 248..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        assert_eq!(gaussians.means[n - 1].to_array(), row[..3]);
        for c in 0..3 {
            assert_eq!(gaussians.sh[(n - 1) * 48 + c], row[6 + c]);
            for k in 1..16 {
                assert_eq!(
                    gaussians.sh[((n - 1) * 16 + k) * 3 + c],
                    row[9 + c * 15 + k - 1]
                );
            }
        }
        assert_eq!(gaussians.opacity_logits[n - 1], row[54]);
        assert_eq!(gaussians.scales_log[n - 1].to_array(), row[55..58]);
        assert_eq!(gaussians.rotations_wxyz[n - 1], row[58..]);

        let path = folder.join(case).join("cameras.json");
        let cameras = read_cameras(&path).unwrap();
        assert_eq!(cameras.len(), n_cameras, "{case}");
        let json: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        for (i, camera) in cameras.iter().enumerate() {
            let w2c = |r: usize, c: usize| json[i]["w2c"][r][c].as_f64().unwrap();
            assert_eq!(json[i]["cx"], camera.cx);
            for r in 0..3 {
                assert!(
                    (camera.translation[r] - w2c(r, 3)).abs() < 1e-5,
                    "{case} {i}"
                );
                for c in 0..3 {
                    assert_eq!(camera.rotation.row(r)[c], w2c(r, c), "{case} {i}");
                }
            }
        }
    }
}

#[test]
fn far_from_the_origin_an_offset_is_taken_out_and_told() {
    let (_folder, path) = scratch("point_cloud.ply");
    let gaussians = distinct(20, 0);
    let frame = Frame {
        center: dvec3(500_001.25, 4_500_000.5, 120.0),
        radius: 4.0,
        extent: 4.0,
    };
    write_ply(&path, &gaussians, &frame).unwrap();
    let stored = read_ply(&path).unwrap();
    assert_eq!(stored.offset, dvec3(500_001.0, 4_500_001.0, 120.0));
    let header = String::from_utf8_lossy(&std::fs::read(&path).unwrap()[..120]).into_owned();
    assert!(
        header.contains("\ncomment offsetx 500001\ncomment offsety 4500001\ncomment offsetz 120\n"),
        "{header}"
    );
    let worst = |offset| {
        let mut stored = stored.clone();
        stored.offset += offset;
        let back = stored.to_canonical(&frame).means;
        let pairs = back.iter().zip(&gaussians.means);
        pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
    };
    assert!(worst(DVec3::ZERO) < 1e-6, "{}", worst(DVec3::ZERO));
    assert!(worst(DVec3::X) > 0.2);
    // A scene near its origin has none.
    let near = Frame {
        center: dvec3(100.0, -50.0, 2.5),
        ..frame
    };
    write_ply(&path, &gaussians, &near).unwrap();
    assert_eq!(read_ply(&path).unwrap().offset, DVec3::ZERO);
    assert!(!String::from_utf8_lossy(&std::fs::read(&path).unwrap()[..120]).contains("comment"));
}
