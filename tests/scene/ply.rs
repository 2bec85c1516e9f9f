//! Clouds as PLY.

use super::build::{Folder, GOOD_PLY, fails_with, ply_with_rows, warns};
use glam::DVec3;
use gspotential::error::{Error, ErrorKind};
use gspotential::scene::{PointCloud, read_cloud};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// A variant of the file that the loader must read.
#[derive(Clone, Copy, Debug)]
struct Variant {
    encoding: Encoding,
    double: bool,
    float_colors: bool,
    confidence: bool,
}

fn variants() -> Vec<Variant> {
    let mut all = Vec::new();
    for encoding in [Encoding::Ascii, Encoding::Little, Encoding::Big] {
        for bits in 0..8 {
            all.push(Variant {
                encoding,
                double: bits & 1 != 0,
                float_colors: bits & 2 != 0,
                confidence: bits & 4 != 0,
            });
        }
    }
    all
}

/// A cloud whose values are exact in `f32`, and take `f64` only where `double`.
fn cloud(double: bool, confidence: bool) -> PointCloud {
    let tiny = if double { 2f64.powi(-40) } else { 0.0 };
    PointCloud {
        positions: (0..50)
            .map(|i| DVec3::new(-3.25 + f64::from(i), 0.5 * f64::from(i) + tiny, 1e5))
            .collect(),
        colors: (0..50u8).map(|i| [i, 255 - i, 5 * i]).collect(),
        confidence: confidence.then(|| (0..50u8).map(|i| 1.0 + 0.125 * f32::from(i)).collect()),
    }
}

/// Collects one row's numbers in the encoding.
struct Row<'a>(&'a mut Vec<u8>, Encoding);

impl Row<'_> {
    fn float(&mut self, value: f64, double: bool) {
        match (self.1, double) {
            (Encoding::Ascii, true) => self.0.extend(format!("{value:e} ").bytes()),
            (Encoding::Ascii, false) => self.0.extend(format!("{} ", value as f32).bytes()),
            (Encoding::Little, true) => self.0.extend(value.to_le_bytes()),
            (Encoding::Little, false) => self.0.extend((value as f32).to_le_bytes()),
            (Encoding::Big, true) => self.0.extend(value.to_be_bytes()),
            (Encoding::Big, false) => self.0.extend((value as f32).to_be_bytes()),
        }
    }

    fn byte(&mut self, value: u8) {
        match self.1 {
            Encoding::Ascii => self.0.extend(format!("{value} ").bytes()),
            _ => self.0.push(value),
        }
    }

    fn end(&mut self) {
        if self.1 == Encoding::Ascii {
            self.0.push(b'\n');
        }
    }
}

/// The file, with elements and properties around the cloud that a reader must skip.
fn encode(cloud: &PointCloud, variant: Variant) -> Vec<u8> {
    let encoding = match variant.encoding {
        Encoding::Ascii => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let float = if variant.double { "double" } else { "float" };
    let color = if variant.float_colors {
        "float"
    } else {
        "uchar"
    };
    let mut header = format!(
        "ply\nformat {encoding} 1.0\ncomment made by hand\n\
         element camera 2\nproperty list uchar float values\nproperty uchar id\n\
         element vertex {}\nproperty {float} x\nproperty {float} y\nproperty {float} z\n\
         property float nx\nproperty list uchar uchar tags\n",
        cloud.len()
    );
    for channel in ["red", "green", "blue"] {
        header += &format!("property {color} {channel}\n");
    }
    if variant.confidence {
        header += "property float confidence\n";
    }
    header += "element face 1\nproperty uchar material\nend_header\n";

    let mut bytes = header.into_bytes();
    let mut row = Row(&mut bytes, variant.encoding);
    for id in [7, 8] {
        row.byte(2);
        row.float(1.5, false);
        row.float(-2.5, false);
        row.byte(id);
        row.end();
    }
    for i in 0..cloud.len() {
        for value in cloud.positions[i].to_array() {
            row.float(value, variant.double);
        }
        row.float(0.0, false);
        row.byte(1);
        row.byte(9);
        for channel in cloud.colors[i] {
            if variant.float_colors {
                row.float(f64::from(channel) / 255.0, false);
            } else {
                row.byte(channel);
            }
        }
        if let Some(confidence) = &cloud.confidence {
            row.float(f64::from(confidence[i]), false);
        }
        row.end();
    }
    row.byte(3);
    row.end();
    bytes
}

fn read(bytes: &[u8]) -> Result<PointCloud, Error> {
    let folder = Folder::empty();
    folder.write("cloud.ply", bytes);
    read_cloud(&folder.path().join("cloud.ply"))
}

#[track_caller]
fn refused(bytes: &[u8], parts: &[&str]) {
    let mut parts = parts.to_vec();
    parts.push("cloud.ply: ");
    fails_with(read(bytes), ErrorKind::Failure, &parts);
}

#[test]
fn every_ply_variant_is_read_exactly() {
    for variant in variants() {
        let cloud = cloud(variant.double, variant.confidence);
        let back = read(&encode(&cloud, variant)).unwrap_or_else(|e| panic!("{variant:?}: {e}"));
        assert_eq!(back, cloud, "{variant:?}");
        let mut altered = cloud.clone();
        altered.positions[49].y += 2f64.powi(-10);
        assert_ne!(back, altered, "{variant:?}");
    }
}

#[test]
fn every_truncation_of_a_binary_ply_is_refused_with_a_byte() {
    for variant in variants() {
        if variant.encoding == Encoding::Ascii {
            continue;
        }
        let bytes = encode(&cloud(variant.double, variant.confidence), variant);
        // The face after the vertices, one byte, is not needed.
        for end in (0..bytes.len() - 1).rev().step_by(37) {
            refused(&bytes[..end], &["byte"]);
        }
        assert!(read(&bytes[..bytes.len() - 1]).is_ok());
    }
}

#[test]
fn truncated_ply_names_the_byte() {
    let bytes = GOOD_PLY.as_bytes();
    let header = GOOD_PLY.find("0 0 5").expect("the first row");
    let last_row = GOOD_PLY.find("-1 2 7").expect("the last row");
    // The count cannot fit: the header is refused.
    refused(
        &bytes[..header + 6],
        &["3 rows", &format!("ends at byte {}", header + 6)],
    );
    // It could fit, but a row is missing, or cut.
    let longer = GOOD_PLY.replace("0 0 5 1", "0 0 5.000000000000000000000000 1");
    let longer_place = format!("line 13 (byte {})", last_row + 25);
    let cut = longer.find("-1 2 7").expect("the last row");
    refused(&longer.as_bytes()[..cut], &["truncated", &longer_place]);
    let cut = longer.find("255 0 0").expect("the last colour");
    refused(&longer.as_bytes()[..cut], &["bad row", &longer_place]);
}

#[test]
fn absurd_ply_counts_cost_nothing() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let file = |count: &str| {
            GOOD_PLY
                .replace("ascii", format)
                .replace("vertex 3", &format!("vertex {count}"))
        };
        refused(file("4000000000").as_bytes(), &["4000000000 rows", "byte"]);
        for count in [
            "1000000000000",
            "18446744073709551615",
            "99999999999999999999999",
            "99999999999999999999999x",
            "-1",
            "1.5",
        ] {
            refused(file(count).as_bytes(), &["line 3", "no valid count", count]);
        }
        // Rows of nothing would be looped over for free.
        let empty = GOOD_PLY.replace("ascii", format).replace(
            "element vertex",
            "element nothing 4000000000\nelement vertex",
        );
        refused(empty.as_bytes(), &["line 4", "no properties"]);
        // A list's own count beyond the file.
        let list = format!(
            "ply\nformat {format} 1.0\nelement face 1\nproperty list int int i\nend_header\n"
        );
        let mut list = list.into_bytes();
        if format == "ascii" {
            list.extend(b"2000000000 1\n");
        } else {
            list.extend([0x7f; 8]);
        }
        refused(&list, &["byte"]);
        let negative = GOOD_PLY.replace(
            "format ascii 1.0",
            &format!("format {format} 9.99999999999999999999"),
        );
        refused(negative.as_bytes(), &["line 2", "not 1.0"]);
    }
}

#[test]
fn ply_headers_that_are_none_are_refused() {
    let changed = |from: &str, to: &str| GOOD_PLY.replace(from, to).into_bytes();
    refused(b"", &["byte 0", "not a PLY"]);
    refused(b"\x89PNG\r\n", &["byte 0", "not a PLY"]);
    refused(
        b"ply\nformat ascii 1.0\nelement vertex 3\n",
        &["no `end_header`", "byte 38"],
    );
    refused(&changed("format ascii 1.0\n", ""), &["header"]);
    refused(&changed("ascii", "zip"), &["header"]);
    refused(&changed("float x", "quaternion x"), &["header"]);
    refused(
        &changed("property float y", "property float x"),
        &["line 5", "`x` appears twice"],
    );
    refused(
        &changed(
            "element vertex",
            "element vertex 1\nproperty uchar a\nelement vertex",
        ),
        &["line 5", "element `vertex` appears twice"],
    );
    refused(&changed("vertex", "corner"), &["no element `vertex`"]);
    refused(
        &changed("uchar green", "uchar grass"),
        &["no `green`", "red green blue"],
    );
    refused(&changed("float z", "int z"), &["`z` has type"]);
    refused(&changed("uchar blue", "ushort blue"), &["`blue` has type"]);
    refused(&changed("float z", "list uchar float z"), &["`z` has type"]);
    refused(
        &changed("end_header", "property float confidence \u{7f}\nend_header"),
        &["header"],
    );
    let mut not_utf8 = changed("end_header", "comment \x01\nend_header");
    let at = not_utf8.iter().position(|&b| b == 1).expect("the comment");
    not_utf8[at] = 0xff;
    refused(&not_utf8, &["line 10", "not UTF-8"]);
}

#[test]
fn bad_ascii_rows_name_their_line() {
    refused(
        ply_with_rows(&["0 0 5 1 2 3", "0 0 5 1 2 x"]).as_bytes(),
        &["line 12", "`x`"],
    );
    refused(
        ply_with_rows(&["0 0 5 1 2 300"]).as_bytes(),
        &["line 11", "300"],
    );
    refused(
        ply_with_rows(&["", "0 0 5.0000000000000000 1 2 3"]).as_bytes(),
        &["line 11"],
    );
    let long = "9".repeat(5000) + "x";
    refused(ply_with_rows(&[&long]).as_bytes(), &["line 11"]);
}

#[test]
fn ascii_numbers_are_read_in_every_usual_spelling() {
    let rows = ["1E1 .5 -2.5e-1 1 2 3", "+1. 2e+1 0x 1 2 3"];
    let cloud = read(ply_with_rows(&rows[..1]).as_bytes()).expect("a cloud");
    assert_eq!(cloud.positions, [DVec3::new(10.0, 0.5, -0.25)]);
    refused(ply_with_rows(&rows[1..]).as_bytes(), &["line 11", "`0x`"]);
    let windows = GOOD_PLY.replace('\n', "\r\n");
    assert_eq!(
        read(windows.as_bytes()).expect("a cloud"),
        read(GOOD_PLY.as_bytes()).expect("a cloud")
    );
}

#[test]
fn float_colors_out_of_range_are_refused() {
    let file = ply_with_rows(&["0 0 5 0.5 1.0 0", "0 0 5 200 10 0"]).replace("uchar", "float");
    refused(file.as_bytes(), &["vertex 1", "colour 200", "uchar"]);
    let file = ply_with_rows(&["0 0 5 0.5 1.0001 0"]).replace("uchar", "float");
    assert_eq!(
        read(file.as_bytes()).expect("a cloud").colors,
        [[128, 255, 0]]
    );
}

#[test]
fn points_that_are_not_finite_are_dropped_and_counted() {
    let rows = [
        "0 0 5 1 2 3",
        "nan 0 5 1 2 3",
        "0 inf 5 1 2 3",
        "0 0 -Infinity 1 2 3",
        "0 0 1e60 1 2 3",
        "1 0 6 4 5 6",
    ];
    let folder = Folder::with_views(&["a.png", "b.png"]);
    folder.write(
        "sparse/0/points3D.ply",
        ply_with_rows(&rows).replace("float", "double"),
    );
    let scene = folder.scene();
    warns(&scene, &["only 2", "4 of 6 points are not finite"]);
    assert_eq!(scene.cloud.colors, [[1, 2, 3], [4, 5, 6]]);
    // The same in binary, where the bits say so.
    let mut cloud = cloud(false, true);
    cloud.positions[3].z = f64::NAN;
    cloud.positions[5].x = f64::NEG_INFINITY;
    cloud.confidence.as_mut().expect("a confidence")[7] = f32::NAN;
    let variant = variants()[8 + 4];
    folder.write("sparse/0/points3D.ply", encode(&cloud, variant));
    let scene = folder.scene();
    warns(&scene, &["only 2", "3 of 50 points are not finite"]);
    assert_eq!(scene.cloud.len(), 47);
    assert_eq!(scene.cloud.confidence.expect("a confidence").len(), 47);
}
