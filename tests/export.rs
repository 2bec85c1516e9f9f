//! Models in the formats of other programs, in a unit that is asked for.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3, Vec3, dvec3};
use gspotential::camera::Similarity;
use gspotential::camera::json::read_cameras;
use gspotential::doctor::twin::sh::basis;
use gspotential::gaussians::gltf::write_gltf;
use gspotential::gaussians::ply::{Stored, read_ply, write_stored};
use gspotential::gaussians::sog::{read_sog, write_sog};
use gspotential::gaussians::splat::{read_splat, write_splat};
use gspotential::gaussians::spz::{moved, read_spz, write_spz};
use gspotential::gaussians::{Format, Gaussians};
use serde_json::Value;

use crate::gaussians_ply::distinct;
use crate::geometry::{Random, scratch};
use crate::kit::program::{run, succeed};

/// The covariance, and the colour that is seen along a direction.
fn covariance(gaussians: &Gaussians, i: usize) -> DMat3 {
    let [w, x, y, z] = gaussians.rotation(i).unwrap().map(f64::from);
    let turn = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scales = gaussians.scales_log[i].as_dvec3().exp();
    turn * DMat3::from_diagonal(scales * scales) * turn.transpose()
}

fn color(gaussians: &Gaussians, i: usize, direction: DVec3) -> [f64; 3] {
    let values = basis(direction.to_array());
    let n = gaussians.n_sh();
    let of = |c: usize| -> f64 {
        let own = |k: usize| f64::from(gaussians.sh[3 * (i * n + k) + c]);
        (0..n).map(|k| values[k] * own(k)).sum()
    };
    [of(0), of(1), of(2)]
}

#[test]
fn gaussians_in_another_frame_are_the_same_seen_from_there() {
    let mut random = Random::new(3);
    let similarity = Similarity {
        scale: 2.5,
        rotation: DMat3::from_quat(DQuat::from_scaled_axis(dvec3(0.7, -1.9, 0.4))),
        translation: dvec3(1.0, -2.0, 0.5),
    };
    for degree in 0..=3 {
        let before = distinct(12, degree);
        let after = before.clone().placed(&similarity);
        for i in 0..12 {
            let mean = similarity.point(before.means[i].as_dvec3());
            assert!(after.means[i].as_dvec3().distance(mean) < 1e-5);
            let turn = similarity.rotation;
            let expected = turn * covariance(&before, i) * turn.transpose() * 6.25;
            let off = (covariance(&after, i) - expected).to_cols_array();
            let size = expected
                .to_cols_array()
                .iter()
                .fold(0.0, |m: f64, v| m.max(v.abs()));
            assert!(off.iter().all(|v| v.abs() < 1e-5 * size), "{off:?}");
            for _ in 0..5 {
                let direction = random.in_cube(1.0).normalize();
                let here = color(&before, i, direction);
                let there = color(&after, i, turn * direction);
                for (a, b) in here.iter().zip(there) {
                    assert!((a - b).abs() < 2e-5, "degree {degree}: {a} {b}");
                }
            }
        }
        assert_eq!(before.clone().placed(&Similarity::IDENTITY), before);
    }
}

/// The JSON of a .glb or .gltf, and its data.
fn gltf(path: &Path) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    if path.extension().is_some_and(|ext| ext == "gltf") {
        let json: Value = serde_json::from_slice(&bytes).unwrap();
        let uri = json["buffers"][0]["uri"].as_str().unwrap();
        let text = uri
            .strip_prefix("data:application/octet-stream;base64,")
            .unwrap();
        use base64::Engine as _;
        let data = base64::engine::general_purpose::STANDARD
            .decode(text)
            .unwrap();
        return (json, data);
    }
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!((word(4), word(8)), (2, bytes.len()));
    assert_eq!(&bytes[16..20], b"JSON");
    let json = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let data = 20 + word(12);
    assert_eq!(&bytes[data + 4..data + 8], b"BIN\0");
    assert_eq!(word(data), bytes.len() - data - 8);
    (json, bytes[data + 8..].to_vec())
}

/// The floats of an attribute, in a row.
fn attribute((json, data): &(Value, Vec<u8>), name: &str) -> Vec<f32> {
    let accessor = &json["meshes"][0]["primitives"][0]["attributes"][name];
    let accessor = &json["accessors"][accessor.as_u64().expect(name) as usize];
    assert_eq!(accessor["componentType"], 5126, "{name}");
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let number = |key: &str| view[key].as_u64().unwrap() as usize;
    let bytes = &data[number("byteOffset")..][..number("byteLength")];
    bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

#[test]
fn gltf_holds_every_number_under_the_extensions_names() {
    let (folder, _) = scratch("a");
    for degree in 0..=3 {
        let mut gaussians = distinct(40, degree);
        gaussians.opacity_logits[7] = -20.0;
        let chosen = gaussians.heaviest(40);
        for name in ["a.glb", "a.gltf"] {
            let path = folder.path().join(name);
            assert_eq!(write_gltf(&path, &gaussians, &mut Vec::new()).unwrap(), 39);
            let file = gltf(&path);
            let primitive = &file.0["meshes"][0]["primitives"][0];
            assert_eq!(primitive["mode"], 0);
            assert_eq!(file.0["extensionsUsed"][0], "KHR_gaussian_splatting");
            let extension = &primitive["extensions"]["KHR_gaussian_splatting"];
            assert_eq!(extension["kernel"], "ellipse");
            assert_eq!(extension["colorSpace"], "srgb_rec709_display");
            let attributes = primitive["attributes"].as_object().unwrap();
            assert_eq!(attributes.len(), 5 + gaussians.n_sh());
            let own = |name: &str| attribute(&file, &format!("KHR_gaussian_splatting:{name}"));
            let (positions, scales) = (attribute(&file, "POSITION"), own("SCALE"));
            let (rotations, opacities) = (own("ROTATION"), own("OPACITY"));
            let last = own(&format!("SH_DEGREE_{degree}_COEF_{}", 2 * degree));
            for (k, i) in chosen.iter().enumerate() {
                assert_eq!(positions[3 * k..][..3], gaussians.means[*i].to_array());
                let scale = gaussians.scales_log[*i].to_array().map(f32::exp);
                assert_eq!(scales[3 * k..][..3], scale);
                let [w, x, y, z] = gaussians.rotation(*i).unwrap();
                assert_eq!(rotations[4 * k..][..4], [x, y, z, w]);
                assert_eq!(opacities[k], gaussians.opacity(*i));
                let n = gaussians.n_sh();
                assert_eq!(last[3 * k..][..3], gaussians.sh[3 * (i * n + n - 1)..][..3]);
            }
        }
    }
}

#[test]
#[ignore = "needs gltf-validator"]
fn gltf_is_valid_to_khronos_validator() {
    let (folder, gaussians) = scratch("gaussians.glb");
    write_gltf(&gaussians, &distinct(40, 3), &mut Vec::new()).unwrap();
    let mesh = folder.path().join("mesh.glb");
    gspotential::mesh::MeshFormat::of(&mesh)
        .unwrap()
        .write(&mesh, &tetrahedron(), DVec3::ZERO)
        .unwrap();
    let script = "const v = require('gltf-validator'), fs = require('fs');
        v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
        .then((r) => console.log(JSON.stringify(r.issues)));";
    for path in [&gaussians, &mesh] {
        let output = std::process::Command::new("node")
            .args(["-e", script])
            .arg(path)
            .output()
            .expect("node");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let issues: Value = serde_json::from_str(&text).expect("a report");
        // A validator older than the extension takes its attributes for misspelt ones.
        let is_known = |issue: &Value| {
            let place = issue["pointer"].as_str().unwrap_or_default();
            let is_name = issue["code"] == "MESH_PRIMITIVE_INVALID_ATTRIBUTE"
                && place.contains("/attributes/KHR_gaussian_splatting:");
            is_name || issue["code"] == "UNSUPPORTED_EXTENSION"
        };
        let messages = issues["messages"].as_array().expect("messages");
        let others: Vec<&Value> = messages.iter().filter(|issue| !is_known(issue)).collect();
        assert!(
            others.is_empty() && issues["truncated"] == false,
            "{others:?}"
        );
    }
}

fn tetrahedron() -> gspotential::mesh::Mesh {
    gspotential::mesh::Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
        colors: vec![[0.5, 0.25, 1.0]; 4],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    }
}

/// Spheres of few sizes and colours, with little view-dependent colour: what a scene is like.
fn lifelike(n: usize, degree: u32) -> Gaussians {
    let mut gaussians = distinct(n, degree);
    for i in 0..n {
        gaussians.scales_log[i] = gaussians.scales_log[i] * 0.5 - 4.0;
        gaussians.opacity_logits[i] = gaussians.opacity_logits[i].abs();
    }
    let n_sh = 3 * gaussians.n_sh();
    for (k, value) in gaussians.sh.iter_mut().enumerate() {
        *value *= if k % n_sh < 3 { 0.5 } else { 0.05 };
    }
    gaussians
}

#[test]
fn compact_formats_are_read_back_within_their_steps() {
    let (folder, _) = scratch("a");
    let at = |name: &str| folder.path().join(name);
    for degree in 0..=3 {
        let gaussians = lifelike(500, degree);
        let no = &mut Vec::new();
        write_splat(&at("a.splat"), &gaussians, no).unwrap();
        write_spz(&at("a.spz"), &gaussians, no).unwrap();
        write_sog(&at("a.sog"), &gaussians, no).unwrap();
        let moved = moved(&gaussians);
        let splat = read_splat(&at("a.splat")).unwrap();
        let spz = read_spz(&at("a.spz")).unwrap();
        let sog = read_sog(&at("a.sog")).unwrap();
        assert_eq!(
            (splat.sh_degree, spz.sh_degree, sog.sh_degree),
            (0, degree, degree)
        );
        for (name, read, place, size, turn, sh) in [
            ("splat", &splat, 1e-6, 1e-6, 0.02, 0.02),
            ("spz", &spz, 1e-5, 0.04, 0.05, 0.08),
            ("sog", &sog, 1e-3, 0.02, 0.02, 0.3),
        ] {
            assert_eq!(read.len(), 500, "{name}");
            for i in 0..500 {
                let mean = match name {
                    "spz" => moved.point(gaussians.means[i].as_dvec3()).as_vec3(),
                    _ => gaussians.means[i],
                };
                let near = |k: &usize| (read.means[*k] - mean).length();
                let k = (0..500).min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
                assert!(
                    near(&k) < place * f32::max(1.0, mean.length()),
                    "{name}: {}",
                    near(&k)
                );
                let scale = gaussians.scales_log[i] + moved_log(name, &moved);
                let off = (read.scales_log[k] - scale).abs().max_element();
                assert!(off < size, "{name}: size {off}");
                let (a, b) = (read.rotation(k).unwrap(), gaussians.rotation(i).unwrap());
                let along: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!(1.0 - along.abs() < turn, "{name}: turn {along}");
                assert!(
                    (read.opacity(k) - gaussians.opacity(i)).abs() < 0.003,
                    "{name}"
                );
                let clamped =
                    |gaussians: &Gaussians, i| gaussians.base_color(i).clamp(Vec3::ZERO, Vec3::ONE);
                let off = clamped(read, k) - clamped(&gaussians, i);
                assert!(off.abs().max_element() < 0.01, "{name}: colour {off}");
                let n = 3 * gaussians.n_sh();
                let (own, there) = (
                    &gaussians.sh[i * n..][3..n],
                    read.sh.get(k * n..(k + 1) * n),
                );
                if name == "splat" {
                    continue;
                }
                for (a, b) in own.iter().zip(&there.unwrap()[3..]) {
                    assert!((a - b).abs() < sh, "{name}: {a} {b}");
                }
            }
        }
    }
}

fn moved_log(name: &str, moved: &Similarity) -> f32 {
    match name {
        "spz" => moved.scale.ln() as f32,
        _ => 0.0,
    }
}

#[test]
fn a_damaged_compact_file_is_an_error() {
    let (folder, _) = scratch("a");
    let gaussians = lifelike(60, 1);
    for (name, format) in [
        ("a.spz", Format::Spz),
        ("a.splat", Format::Splat),
        ("a.sog", Format::Sog),
    ] {
        let path = folder.path().join(name);
        let stored = Stored {
            gaussians: gaussians.clone(),
            offset: DVec3::ZERO,
        };
        format
            .write(&path, &stored, false, &mut Vec::new())
            .unwrap();
        let whole = std::fs::read(&path).unwrap();
        for n in [0, 1, 20, whole.len() / 2 + 3, whole.len() - 1] {
            std::fs::write(&path, &whole[..n]).unwrap();
            let read = format.read_back(&path, &stored);
            assert!(
                read.is_err() || n == 0 && name == "a.splat",
                "{name} of {n} bytes"
            );
        }
    }
}

#[test]
fn a_lean_ply_lacks_what_says_nothing_and_is_read_alike() {
    let (_folder, path) = scratch("a.ply");
    let mut gaussians = distinct(30, 3);
    for (k, value) in gaussians.sh.iter_mut().enumerate() {
        if k % 48 >= 12 {
            *value = 0.0;
        }
    }
    let stored = Stored {
        gaussians,
        offset: dvec3(1e6, 0.0, 2.5),
    };
    write_stored(&path, &stored, false).unwrap();
    assert!(read_ply(&path).unwrap() == stored);
    write_stored(&path, &stored, true).unwrap();
    let lean = read_ply(&path).unwrap();
    assert_eq!((lean.offset, lean.gaussians.sh_degree), (stored.offset, 1));
    assert_eq!(lean.gaussians, stored.gaussians.without_empty_degrees());
    let text = std::fs::read(&path).unwrap();
    assert!(!String::from_utf8_lossy(&text[..900]).contains("float nx"));
}

/// A run of a few iterations, whose Gaussians are opaque.
fn tiny_run() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let train = "train --scene builtin:48 --iterations 3 --set views.count=6 --set scene.n_test=2 \
                 --max-points 2000 --out run";
    succeed(folder.path(), train);
    let ply = folder.path().join("run/point_cloud.ply");
    let mut stored = read_ply(&ply).unwrap();
    stored.gaussians.opacity_logits.fill(3.0);
    write_stored(&ply, &stored, false).unwrap();
    folder
}

#[test]
fn a_run_is_exported_in_metres_upright_and_as_a_mesh() {
    let folder = tiny_run();
    let at = |name: &str| folder.path().join(name);
    let export = |rest: &str| succeed(folder.path(), &format!("export run {rest}"));
    let model = read_ply(&at("run/point_cloud.ply")).unwrap().gaussians;

    export("--metres train_00.png:train_02.png=7 --out m.ply --cameras m.json");
    let [old, new] = ["run/cameras.json", "m.json"].map(|name| read_cameras(&at(name)).unwrap());
    let apart = |cameras: &[gspotential::camera::Camera]| {
        let of = |name: &str| cameras.iter().find(|c| c.name == name).unwrap().center();
        of("train_00.png").distance(of("train_02.png"))
    };
    assert!((apart(&new) - 7.0).abs() < 1e-9 && new.len() == old.len());
    let factor = 7.0 / apart(&old);
    let metres = read_ply(&at("m.ply")).unwrap().gaussians;
    for i in 0..model.len() {
        let expected = model.means[i].as_dvec3() * factor;
        assert!(metres.means[i].as_dvec3().distance(expected) < 1e-5 * (1.0 + expected.length()));
        let grown = metres.scales_log[i].x - model.scales_log[i].x;
        assert!((f64::from(grown) - factor.ln()).abs() < 1e-5);
    }
    // The scene is so large that a near plane of 0.2 cuts off a little; the next power of 2 is it.
    let log = export("--viewer-safe --out safe.ply").log;
    let safe = read_ply(&at("safe.ply")).unwrap().gaussians;
    let grown = (safe.scales_log[0].x - model.scales_log[0].x) / std::f32::consts::LN_2;
    assert!(
        grown > 0.5 && (grown - grown.round()).abs() < 1e-4,
        "{grown}: {log}"
    );

    // Upwards is y there and z here, as the cameras stand; their ups are not quite the world's.
    export("--out up.glb --out same.splat");
    let up = attribute(&gltf(&at("up.glb")), "POSITION");
    let same = read_splat(&at("same.splat")).unwrap();
    let pairs = || same.means.iter().zip(up.chunks_exact(3));
    for (here, there) in pairs() {
        let off = here.length() - Vec3::from_slice(there).length();
        assert!(off.abs() < 1e-3, "a rotation keeps lengths: {off}");
    }
    let heights: Vec<[f32; 2]> = pairs().map(|(here, there)| [here.z, there[1]]).collect();
    let dot: f32 = heights.iter().map(|[here, there]| here * there).sum();
    let length = |k: usize| {
        heights
            .iter()
            .map(|pair| pair[k].powi(2))
            .sum::<f32>()
            .sqrt()
    };
    let alike = dot / (length(0) * length(1));
    assert!(alike > 0.9, "{alike}");

    export("--mesh --mesh-voxels 64 --out m.obj --out m.glb --scale 3");
    let text = std::fs::read_to_string(at("m.obj")).unwrap();
    let count = |letter: &str| text.lines().filter(|line| line.starts_with(letter)).count();
    assert!(count("f ") > 100 && count("v ") > 50);
    let mesh = gltf(&at("m.glb"));
    assert_eq!(mesh.0["meshes"][0]["primitives"][0]["mode"], 4);
    assert_eq!(attribute(&mesh, "POSITION").len(), 3 * count("v "));

    let table = export("--measure --out c.ply --out c.spz --out c.sog --out c.splat --lean").stdout;
    for part in ["c.ply", "c.spz", "c.sog", "c.splat", " inf ", "PSNR"] {
        assert!(table.contains(part), "{part}: {table}");
    }
}

#[test]
fn exports_that_cannot_be_are_refused() {
    let folder = tiny_run();
    for (rest, code, parts) in [
        ("run --out a.obj", 2, &["a.obj", "--mesh"][..]),
        ("run --out a.xyz", 2, &["a.xyz", ".spz", ".glb"]),
        ("run --mesh --out a.spz", 2, &["a.spz", ".obj"]),
        ("run --mesh --lean --out a.ply", 2, &["--lean"]),
        ("run --mesh --measure --out a.ply", 2, &["--measure"]),
        ("run --lean --out a.spz", 2, &["--lean"]),
        (
            "run --out a.ply --metres train_00.png:nobody=2",
            2,
            &["`nobody`", "train_01.png"],
        ),
        (
            "run --out a.ply --metres train_00.png:train_00.png=2",
            2,
            &["one place"],
        ),
        (
            "run --out a.ply --metres train_00.png:train_01.png=0",
            2,
            &["above 0"],
        ),
        (
            "run --out a.ply --metres train_00.png:train_01.png=x",
            2,
            &["VIEW:VIEW=LENGTH"],
        ),
        (
            "run --out a.ply --metres train_00.png:train_01.png=1e300",
            2,
            &["f32"],
        ),
        ("run --out a.ply --scale 0", 2, &["--scale"]),
        ("run --out a.ply --scale nan", 2, &["--scale"]),
        (
            "run --out a.ply --scale 2 --viewer-safe",
            2,
            &["--viewer-safe"],
        ),
        (
            "run/point_cloud.ply --out a.ply --metres a:b=2",
            2,
            &["--metres", "run's directory"],
        ),
        (
            "run/point_cloud.ply --out a.ply --viewer-safe",
            2,
            &["run's directory"],
        ),
        (
            "run/point_cloud.ply --out a.ply --cameras a.json",
            2,
            &["run's directory"],
        ),
        (
            "run/point_cloud.ply --mesh --out a.ply",
            2,
            &["run's directory"],
        ),
        (
            "run/point_cloud.ply --measure --out a.ply",
            2,
            &["run's directory"],
        ),
        (
            "run --mesh --mesh-voxels 8 --out a.ply",
            2,
            &["--mesh-voxels"],
        ),
        (
            "run --mesh --mesh-voxels 4096 --out a.ply",
            1,
            &["MiB", "--mesh-voxels"],
        ),
    ] {
        let ended = run(folder.path(), &format!("export {rest}"));
        assert_eq!(ended.code, Some(code), "{rest}: {}", ended.log);
        for part in parts {
            assert!(ended.log.contains(part), "{rest}: no {part}: {}", ended.log);
        }
        assert!(ended.log.lines().filter(|l| l.starts_with("error")).count() == 1);
    }
    assert!(!folder.path().join("a.obj").exists());
}
