//! The Gaussians at the start, their PLY file, and cameras.json.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::{Camera, Frame};
use gspotential::cameras_json::{read_cameras, write_cameras};
use gspotential::gaussians::Gaussians;
use gspotential::gaussians::ply::{read_ply, write_ply};

use crate::geometry::{Random, camera, cloud, paper, ring};

fn start(positions: Vec<DVec3>) -> Gaussians {
    Gaussians::from_cloud(&cloud(positions), &Frame::IDENTITY, &paper().model).unwrap()
}

fn scales(positions: Vec<DVec3>) -> Vec<f64> {
    let gaussians = start(positions);
    let scale = |s: &Vec3| {
        assert!(s.x == s.y && s.y == s.z, "not isotropic: {s}");
        f64::from(s.x).exp()
    };
    gaussians.scales_log.iter().map(scale).collect()
}

fn close(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < 1e-5
}

#[test]
fn scales_equal_the_brute_force_neighbour_distances() {
    let mut random = Random::new(11);
    let mut positions: Vec<DVec3> = (0..600).map(|_| random.in_cube(1.0)).collect();
    // Pairs, triples and quadruples at one place.
    for n_copies in [2, 3, 4, 5] {
        let place = random.in_cube(1.0);
        positions.extend(std::iter::repeat_n(place, n_copies));
    }
    let scales = scales(positions.clone());
    let rounded: Vec<DVec3> = positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
    let mut twins: Vec<f64> = rounded
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let mut squared: Vec<f64> = rounded
                .iter()
                .enumerate()
                .filter(|(j, _)| *j != i)
                .map(|(_, q)| p.distance_squared(*q))
                .collect();
            squared.sort_by(f64::total_cmp);
            (squared[..3].iter().sum::<f64>() / 3.0).max(1e-7).sqrt()
        })
        .collect();
    let mut apart: Vec<f64> = twins.iter().copied().filter(|s| *s > 3.2e-4).collect();
    apart.sort_by(f64::total_cmp);
    let ceiling = 10.0 * apart[apart.len() / 2];
    twins.iter_mut().for_each(|t| *t = t.min(ceiling));
    for (i, (scale, twin)) in scales.iter().zip(&twins).enumerate() {
        assert!(close(*scale, *twin), "{i}: {scale} for {twin}");
    }
}

#[test]
fn an_isolated_point_is_bounded_by_the_median() {
    let mut positions: Vec<DVec3> = (0..100)
        .map(|i| dvec3(f64::from(i % 10), f64::from(i / 10), 0.0) * 0.1)
        .collect();
    positions.push(dvec3(0.0, 0.0, 50.0));
    let scales = scales(positions);
    assert!(close(scales[55], 0.1));
    assert!(close(scales[100], 10.0 * 0.1), "{}", scales[100]);
}

#[test]
fn clouds_of_few_points_start_with_sensible_scales() {
    assert!(close(scales(vec![DVec3::ONE])[0], 0.01));
    let two = scales(vec![DVec3::ZERO, dvec3(0.3, 0.4, 0.0)]);
    assert!(close(two[0], 0.5) && close(two[1], 0.5), "{two:?}");
    let three = scales(vec![DVec3::ZERO, DVec3::X, dvec3(0.0, 1.0, 0.0)]);
    assert!(
        close(three[0], 1.0) && close(three[1], 1.5f64.sqrt()),
        "{three:?}"
    );
    // -0 is the same place as 0.
    for same in [vec![DVec3::ONE; 2], vec![DVec3::ZERO, -DVec3::ZERO]] {
        assert!(close(scales(same)[0], 1e-7f64.sqrt()));
    }
}

#[test]
fn many_points_at_one_place_are_bounded_and_cost_no_quadratic_time() {
    // Invalid pixels often all lie at the origin.
    let mut positions = vec![DVec3::ZERO; 100_000];
    positions.extend((0..1000).map(|i| {
        dvec3(
            f64::from(i % 10),
            f64::from(i / 10 % 10),
            f64::from(i / 100),
        ) * 0.1
            + 3.0
    }));
    let started = std::time::Instant::now();
    let scales = scales(positions);
    assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
    assert!(scales[..100_000].iter().all(|s| close(*s, 1e-7f64.sqrt())));
    // The crowd does not drag the bound of the others down.
    assert!(scales[100_000..].iter().all(|s| close(*s, 0.1)));
}

#[test]
fn gaussians_start_as_3dgs_does() {
    let mut points = cloud(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
    points.colors = vec![[0, 51, 255], [255; 3], [0; 3], [128; 3]];
    let frame = Frame {
        center: dvec3(1.0, 2.0, 3.0),
        radius: 4.0,
    };
    let gaussians = Gaussians::from_cloud(&points, &frame, &paper().model).unwrap();
    assert_eq!(gaussians.len(), 4);
    assert_eq!(gaussians.means[0], Vec3::new(-0.25, -0.5, -0.75));
    // Three neighbours at 1, in a frame four times smaller.
    assert!(close(f64::from(gaussians.scales_log[0].x).exp(), 0.25));
    assert_eq!(gaussians.rotations_wxyz, [[1.0, 0.0, 0.0, 0.0]; 4]);
    let opacity = 1.0 / (1.0 + f64::from(-gaussians.opacity_logits[0]).exp());
    assert!((opacity - 0.1).abs() < 1e-7);
    assert_eq!(
        (gaussians.sh_degree, gaussians.n_sh(), gaussians.sh.len()),
        (3, 16, 4 * 48)
    );
    for (sh, rgb) in gaussians.sh.chunks(48).zip(&points.colors) {
        for (dc, value) in sh.iter().zip(rgb) {
            let color = 0.5 + 0.5 / std::f64::consts::PI.sqrt() * f64::from(*dc);
            assert!((color - f64::from(*value) / 255.0).abs() < 1e-7);
        }
        assert!(sh[3..].iter().all(|v| *v == 0.0));
    }
}

#[test]
fn gaussians_do_not_depend_on_the_number_of_threads() {
    let mut random = Random::new(3);
    let positions: Vec<DVec3> = (0..5000).map(|_| random.in_cube(1.0)).collect();
    let run = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .unwrap();
        pool.install(|| start(positions.clone()))
    };
    assert!(run(1) == run(3));
}

#[test]
fn what_cannot_become_gaussians_is_an_error() {
    let mut model = paper().model;
    let error = |points: &_, frame: &Frame, model: &_| {
        Gaussians::from_cloud(points, frame, model)
            .unwrap_err()
            .to_string()
    };
    assert!(error(&cloud(vec![]), &Frame::IDENTITY, &model).contains("no point"));
    let tiny = Frame {
        center: DVec3::ZERO,
        radius: 1e-60,
    };
    let text = error(&cloud(vec![DVec3::ZERO, DVec3::X]), &tiny, &model);
    assert!(text.contains("cloud point 1"), "{text}");
    model.initial_opacity = 1.0;
    assert!(error(&cloud(vec![DVec3::X]), &Frame::IDENTITY, &model).contains("initial_opacity"));
    model.sh_degree = 4;
    assert!(error(&cloud(vec![DVec3::X]), &Frame::IDENTITY, &model).contains("sh_degree"));
}

/// Gaussians with every value different.
fn distinct(n: usize, sh_degree: u32) -> Gaussians {
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
fn gaussians_that_cannot_be_drawn_are_counted() {
    let mut gaussians = distinct(6, 0);
    assert_eq!(gaussians.n_not_finite(), 0);
    gaussians.means[0].y = f32::NAN;
    gaussians.scales_log[1].z = f32::INFINITY;
    gaussians.rotations_wxyz[2][3] = f32::NEG_INFINITY;
    gaussians.opacity_logits[3] = f32::NAN;
    assert_eq!(gaussians.n_not_finite(), 4);
}

fn scratch(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

#[test]
fn ply_round_trip_is_bit_exact_for_every_degree() {
    let (_folder, path) = scratch("point_cloud.ply");
    for sh_degree in 0..=3 {
        for n in [0, 1, 37] {
            let gaussians = distinct(n, sh_degree);
            write_ply(&path, &gaussians, &Frame::IDENTITY).unwrap();
            assert!(
                read_ply(&path).unwrap() == gaussians,
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
    };
    let gaussians = distinct(20, 0);
    write_ply(&path, &gaussians, &frame).unwrap();
    let world = read_ply(&path).unwrap();
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
    let gaussians = read_ply(&path).unwrap();
    assert_eq!(gaussians.rotations_wxyz, [[4.0, 3.0, 2.0, 1.0]]);
    assert_eq!(gaussians.means, [Vec3::new(7.0, 6.0, 5.0)]);
    assert_eq!(gaussians.scales_log, [Vec3::new(10.0, 9.0, 8.0)]);
    assert_eq!(gaussians.opacity_logits, [11.0]);
    assert_eq!(gaussians.sh, [14.0, 13.0, 12.0]);
    assert_eq!(gaussians.sh_degree, 0);
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
fn a_huge_vertex_count_costs_nothing() {
    let (_folder, path) = scratch("point_cloud.ply");
    write_ply(&path, &distinct(1, 0), &Frame::IDENTITY).unwrap();
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    let header = &text[..text.find("end_header\n").unwrap() + 11];
    for (count, expected) in [
        ("1000000000000", "of the 1000000000000"),
        ("999999999999999", "of the 999999999999999"),
        (
            "18446744073709551615",
            "line 3: a number has too many digits",
        ),
        (
            "99999999999999999999999999",
            "line 3: a number has too many digits",
        ),
        ("-1", "cannot be parsed"),
        ("1e3", "cannot be parsed"),
    ] {
        let header = header.replace("vertex 1\n", &format!("vertex {count}\n"));
        let started = std::time::Instant::now();
        let text = ply_error(header.as_bytes());
        assert!(text.contains(expected), "{text}");
        assert!(started.elapsed().as_millis() < 500);
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
            "declares a name twice",
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
        ("ply\n", "plyx\n", "cannot be parsed"),
        ("ply\n", "hello\n", "not a PLY file"),
        ("end_header\n", "", "no end_header"),
        (
            "property float y\n",
            "property half y\n",
            "cannot be parsed",
        ),
    ] {
        let text = replaced(from, to);
        assert!(text.contains(expected), "{from:?} -> {to:?}: {text}");
    }
    assert!(ply_error(b"").contains("not a PLY file"));
    let missing = read_ply(Path::new("no/such.ply")).unwrap_err().to_string();
    assert!(missing.starts_with("no/such.ply: cannot read"), "{missing}");
}

/// The optional fixtures, or `None` with a line on stderr.
fn fixtures() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/fixtures");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("{} is absent: its files were not read", folder.display());
    None
}

#[test]
fn reference_files_read_as_their_readme_says() {
    let Some(folder) = fixtures() else { return };
    for (case, n, n_cameras) in [
        ("garden", 2933, 3),
        ("random", 1990, 2),
        ("huge", 1, 2),
        ("near", 300, 3),
    ] {
        let gaussians = read_ply(&folder.join(case).join("gaussians.ply")).unwrap();
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
fn cameras_json_round_trip_keeps_the_cameras() {
    let (_folder, path) = scratch("cameras.json");
    let mut cameras = ring(5, dvec3(100.0, 2.0, 3.0));
    cameras.push(Camera {
        cx: 3.25,
        cy: 40.0,
        name: "left/00.jpg".into(),
        ..camera(DVec3::ZERO, DVec3::Y)
    });
    write_cameras(&path, &cameras).unwrap();
    let back = read_cameras(&path).unwrap();
    assert_eq!(back.len(), cameras.len());
    for (a, b) in back.iter().zip(&cameras) {
        assert!(a.translation.distance(b.translation) < 1e-11);
        let rest = Camera {
            translation: b.translation,
            ..a.clone()
        };
        assert_eq!(&rest, b);
    }
}

#[test]
fn cameras_json_holds_centre_and_transposed_rotation() {
    let (_folder, path) = scratch("cameras.json");
    let eye = dvec3(3.0, -1.0, 2.0);
    let target = dvec3(0.5, 0.25, 0.0);
    write_cameras(&path, &[camera(eye, target)]).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let forward = (target - eye).normalize();
    for i in 0..3 {
        assert!((number(&json[0]["position"][i]) - eye[i]).abs() < 1e-12);
        // The last column of the camera-to-world rotation is the viewing direction.
        assert!((number(&json[0]["rotation"][i][2]) - forward[i]).abs() < 1e-12);
    }
}

#[test]
fn cameras_json_without_principal_point_centres_it() {
    let (_folder, path) = scratch("cameras.json");
    let entry = r#"[{"id": 7, "img_name": "00", "width": 101, "height": 50, "fx": 9.5, "fy": 9,
        "position": [1, 2, 3], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "extra": null}]"#;
    std::fs::write(&path, entry).unwrap();
    let camera = &read_cameras(&path).unwrap()[0];
    assert_eq!((camera.cx, camera.cy), (50.5, 25.0));
    assert_eq!(camera.translation, dvec3(-1.0, -2.0, -3.0));
}

#[test]
fn bad_cameras_json_names_file_and_entry() {
    let (_folder, path) = scratch("cameras.json");
    write_cameras(&path, &ring(3, DVec3::ZERO)).unwrap();
    let good: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let error = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let text = read_cameras(&path).unwrap_err().to_string();
        assert!(text.starts_with(&path.display().to_string()), "{text}");
        text
    };
    for (key, value, expected) in [
        ("fx", serde_json::Value::Null, "entry 1: "),
        ("fy", 0.0.into(), "fy is 0"),
        ("fx", 1e300.into(), "fx is 1e300 pixels"),
        ("cx", (-1e10).into(), "cx is -1e10 pixels"),
        ("width", 0.into(), "image size is 0x48"),
        ("width", (-3).into(), "entry 1: "),
        ("height", 5_000_000_000u64.into(), "entry 1: "),
        (
            "img_name",
            "../../etc/passwd".into(),
            "not a plain relative file name",
        ),
        (
            "img_name",
            "/tmp/x".into(),
            "not a plain relative file name",
        ),
        ("img_name", "".into(), "not a plain relative file name"),
        ("position", serde_json::json!([1, 2]), "entry 1: "),
        (
            "position",
            serde_json::json!([1.7e308, 1.7e308, 1.7e308]),
            "too large",
        ),
        (
            "rotation",
            serde_json::json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]]),
            "not a rotation",
        ),
        (
            "rotation",
            serde_json::json!([[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
            "not a rotation",
        ),
        ("img_name", good[0]["img_name"].clone(), "was used before"),
    ] {
        let mut bad = good.clone();
        bad[1][key] = value;
        let text = error(&bad.to_string());
        assert!(
            text.contains("entry 1") && text.contains(expected),
            "{key}: {text}"
        );
    }
    let mut bad = good.clone();
    bad[2].as_object_mut().unwrap().remove("rotation");
    assert!(error(&bad.to_string()).contains("entry 2: missing field `rotation`"));
    assert!(error("[{]").contains("line 1 column"));
    assert!(error("{}").contains("not a JSON list"));
}
