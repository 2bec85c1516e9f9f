//! Which cloud is taken, COLMAP's points, cleaning, thinning.

use super::build::{Folder, GOOD_PLY, fails_with, images_txt, options, ply_with_rows, warns};
use glam::DVec3;
use gspotential::error::ErrorKind;
use gspotential::scene::builtin::surface_distance;
use gspotential::scene::{
    CloudSource, LoadOptions, PointCloud, Scene, SceneSource, load_builtin, n_cloud_views,
    random_like, read_cloud, thin, write_cloud,
};

fn points_bin() -> Vec<u8> {
    let mut bytes = 2u64.to_le_bytes().to_vec();
    for (i, track) in [(0u8, 3u64), (1, 0)] {
        bytes.extend(u64::from(i).to_le_bytes());
        for value in [f64::from(i), 0.25, 5.0] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([10 + i, 20, 30]);
        bytes.extend(0.5f64.to_le_bytes());
        bytes.extend(track.to_le_bytes());
        bytes.resize(bytes.len() + 8 * track as usize, 1);
    }
    bytes
}

const POINTS_TXT: &str = "# points\n7 0 0.25 5 10 20 30 0.5 1 0 2 1\n8 1 0.25 5 11 20 30 0.5\n";

fn expected() -> PointCloud {
    PointCloud {
        positions: vec![DVec3::new(0.0, 0.25, 5.0), DVec3::new(1.0, 0.25, 5.0)],
        colors: vec![[10, 20, 30], [11, 20, 30]],
        confidence: None,
    }
}

#[test]
fn colmap_points_are_read_from_both_encodings() {
    for (name, bytes) in [
        ("points3D.bin", points_bin()),
        ("points3D.txt", POINTS_TXT.as_bytes().to_vec()),
    ] {
        let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
        folder.remove("sparse/0/points3D.ply");
        folder.write(&format!("sparse/0/{name}"), bytes);
        let scene = folder.scene();
        warns(&scene, &[]);
        assert_eq!(scene.cloud, expected(), "{name}");
        assert!(scene.source.contains(name), "{}", scene.source);
    }
}

#[test]
fn every_truncation_of_a_points_bin_is_refused_with_its_byte() {
    let folder = Folder::empty();
    let path = folder.path().join("points3D.bin");
    let bytes = points_bin();
    for end in 0..bytes.len() {
        folder.write("points3D.bin", &bytes[..end]);
        let place = format!("ends at byte {end}");
        fails_with(
            read_cloud(&path),
            ErrorKind::Failure,
            &["points3D.bin: byte", &place],
        );
    }
}

#[test]
fn absurd_counts_in_a_points_bin_cost_nothing() {
    let folder = Folder::empty();
    let path = folder.path().join("points3D.bin");
    for count in [3, 1 << 40, u64::MAX] {
        let mut bytes = points_bin();
        bytes[..8].copy_from_slice(&count.to_le_bytes());
        folder.write("points3D.bin", &bytes);
        let parts = ["byte 0", &format!("{count} points"), "at most 2"];
        fails_with(read_cloud(&path), ErrorKind::Failure, &parts);
        let mut bytes = points_bin();
        bytes[8 + 43..8 + 51].copy_from_slice(&count.to_le_bytes());
        folder.write("points3D.bin", &bytes);
        if count > 3 {
            fails_with(
                read_cloud(&path),
                ErrorKind::Failure,
                &["byte 51", "observations"],
            );
        }
    }
}

#[test]
fn bad_lines_of_a_points_txt_are_named() {
    let folder = Folder::empty();
    let path = folder.path().join("points3D.txt");
    for (line, part) in [
        ("7 0 0.25", "line ends"),
        ("7 0 0.25 5 10 20 256 0.5", "colour"),
        ("7 0 zero 5 10 20 30 0.5", "zero"),
    ] {
        folder.write("points3D.txt", format!("{POINTS_TXT}{line}\n"));
        fails_with(read_cloud(&path), ErrorKind::Failure, &["line 4", part]);
    }
}

#[test]
fn clouds_are_looked_for_in_the_stated_order() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    folder.remove("sparse/0/points3D.ply");
    folder.fails_with(&["sparse/0", "no point cloud", "points3D.ply"]);
    // From the last choice to the first: each must win over all before it.
    folder.write("sparse/0/points3D.txt", POINTS_TXT);
    assert!(folder.scene().source.ends_with("sparse/0/points3D.txt"));
    folder.write("sparse/0/points3D.bin", points_bin());
    assert!(folder.scene().source.ends_with("sparse/0/points3D.bin"));
    for name in [
        "points.ply",
        "sparse/0/points.ply",
        "points3D.ply",
        "sparse/0/points3D.ply",
    ] {
        folder.write(name, GOOD_PLY);
        let source = folder.scene().source;
        assert_eq!(source, format!("sparse/0 (text), cloud {name}"));
    }
}

#[test]
fn points_at_a_camera_centre_are_dropped_and_counted() {
    // Cameras at x = 0, 1, 2, 3: their median distance from the middle one is 1.
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    let rows = [
        "0 0 0 1 1 1",
        "2.0000009 0 0 2 2 2",
        "2 0.0000006 0.0000006 3 3 3",
        "2.00001 0 0 4 4 4",
        "3 0 5 5 5 5",
    ];
    let file = ply_with_rows(&rows).replace("float", "double");
    folder.write("sparse/0/points3D.ply", file);
    let scene = folder.scene();
    warns(&scene, &["3 of 5 points lie at a camera centre"]);
    assert_eq!(scene.cloud.colors, [[4; 3], [5; 3]]);
    // A camera far away, used or not, widens the tolerance of the others by nothing.
    let images = images_txt(&["a.png", "b.png", "c.png", "d.png", "far.png"]);
    folder.write("sparse/0/images.txt", images.replace("-4 0 0", "4e9 0 0"));
    let scene = folder.scene();
    warns(
        &scene,
        &[
            "1 poses have no image",
            "3 of 5 points lie at a camera centre",
        ],
    );
    // A single camera has no extent: the points' distance stands in.
    let folder = Folder::with_views(&["a.png"]);
    folder.write(
        "sparse/0/points3D.ply",
        ply_with_rows(&["0 0 1e-9 1 1 1", "0 0 5 2 2 2", "0 1 5 3 3 3"]),
    );
    let scene = folder.scene();
    warns(&scene, &["only 1", "1 of 3 points lie at a camera centre"]);
}

#[test]
fn clouds_without_a_usable_point_are_refused() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    folder.write("sparse/0/points3D.ply", ply_with_rows(&[]));
    folder.fails_with(&["points3D.ply", "no usable point (0 in the file)"]);
    folder.write(
        "sparse/0/points3D.ply",
        ply_with_rows(&["nan 0 0 1 2 3", "1 0 0 1 2 3"]),
    );
    folder.fails_with(&["points3D.ply", "no usable point (2 in the file)"]);
}

/// Points that carry their index three times.
fn numbered(n: usize) -> PointCloud {
    PointCloud {
        positions: (0..n).map(|i| DVec3::splat(i as f64)).collect(),
        colors: (0..n)
            .map(|i| [(i % 256) as u8, (i / 256) as u8, 0])
            .collect(),
        confidence: Some((0..n).map(|i| i as f32).collect()),
    }
}

#[test]
fn thinning_is_even_ordered_and_seeded() {
    let cloud = numbered(1003);
    let thinned = thin(&cloud, 100, 7);
    let index: Vec<f64> = thinned.positions.iter().map(|p| p.x).collect();
    assert_eq!(index.len(), 100);
    for (stretch, &i) in index.iter().enumerate() {
        let stretch = stretch as f64;
        assert!(
            i >= (stretch * 10.03).floor() && i < ((stretch + 1.0) * 10.03).floor(),
            "{i}"
        );
        let at = i as usize;
        let same = thinned
            .positions
            .iter()
            .position(|p| p.x == i)
            .expect("itself");
        assert_eq!(thinned.colors[same], cloud.colors[at]);
        assert_eq!(
            thinned.confidence.as_ref().map(|c| c[same]),
            Some(at as f32)
        );
    }
    assert_eq!(thinned, thin(&cloud, 100, 7));
    assert_ne!(thinned, thin(&cloud, 100, 8));
    assert_eq!(thin(&cloud, 1003, 7), cloud);
    assert_eq!(thin(&cloud, usize::MAX, 7), cloud);
    assert!(thin(&cloud, 0, 7).is_empty());
}

#[test]
fn thinning_draws_every_point_alike() {
    let cloud = numbered(30);
    let mut drawn = [0; 30];
    for seed in 0..3000 {
        for p in thin(&cloud, 10, seed).positions {
            drawn[p.x as usize] += 1;
        }
    }
    // 1000 expected each, standard deviation 26.
    assert!(drawn.iter().all(|&n| (870..1130).contains(&n)), "{drawn:?}");
}

#[test]
fn thinning_draws_the_same_on_every_platform() {
    let index: Vec<f64> = thin(&numbered(1000), 5, 42)
        .positions
        .iter()
        .map(|p| p.x)
        .collect();
    assert_eq!(
        index,
        [44.0, 300.0, 502.0, 760.0, 963.0],
        "the draw of this seed has changed"
    );
}

#[test]
fn another_cloud_is_found_in_the_scene_beside_the_model_and_by_its_path() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    let other = ply_with_rows(&["0 1 5 9 9 9"]);
    folder.write("other.ply", &other);
    folder.write("sparse/0/beside.ply", &other);
    let elsewhere = Folder::empty();
    elsewhere.write("far.ply", &other);
    let source = SceneSource::Folder(folder.path().to_owned());
    let far = elsewhere.path().join("far.ply");
    // A scene without a cloud of its own is one with a cloud that is named.
    folder.remove("sparse/0/points3D.ply");
    folder.fails_with(&["no point cloud beside the model"]);
    for name in ["other.ply", "beside.ply", far.to_str().expect("UTF-8")] {
        let cloud: CloudSource = name.parse().expect("a cloud");
        let cloud = cloud.resolved(&source).expect("a file");
        // As a run records it, and as it is read from there.
        let recorded = cloud.to_string();
        assert!(std::path::Path::new(&recorded).is_absolute(), "{recorded}");
        assert_eq!(recorded.parse::<CloudSource>().expect("a cloud"), cloud);
        let with_cloud = LoadOptions {
            cloud: Some(cloud),
            ..options()
        };
        let scene = folder.load_with(&with_cloud).expect("a scene");
        assert_eq!(scene.cloud.colors, [[9, 9, 9]], "{name}");
        assert!(scene.source.contains(name), "{}", scene.source);
    }
    let missing: CloudSource = "no.ply".parse().expect("a cloud");
    let missing = missing.resolved(&source);
    fails_with(missing, ErrorKind::Failure, &["no.ply: no such cloud file"]);
    for (text, part) in [
        ("", "no cloud"),
        ("views:0", "1 to 8"),
        ("views:9", "1 to 8"),
    ] {
        fails_with(text.parse::<CloudSource>(), ErrorKind::Usage, &[part]);
    }
}

#[test]
fn a_cloud_is_made_of_the_points_of_its_first_views() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    let path = "sparse/0/points3D.ply";
    let of_views = |n: usize| LoadOptions {
        cloud: Some(CloudSource::Views(n)),
        ..options()
    };
    let header = |kind: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty \
             float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty {kind} \
             view\nend_header\n"
        )
    };
    let rows = "0 0 5 1 2 3 0\n1 0 5 4 5 6 2\n2 0 5 7 8 9 1\n";
    for kind in ["uchar", "int", "uint"] {
        folder.write(path, header(kind) + rows);
        for (n, right) in [(1, &[[1, 2, 3]][..]), (2, &[[1, 2, 3], [7, 8, 9]])] {
            let scene = folder.load_with(&of_views(n)).expect("a scene");
            assert_eq!(scene.cloud.colors, right, "{kind} {n}");
            assert!(scene.source.contains("first"), "{}", scene.source);
        }
        assert_eq!(folder.scene().cloud.len(), 3);
        assert_eq!(n_cloud_views(folder.path(), &[]).expect("a cloud"), 3);
    }
    let failed = |parts: &[&str]| {
        let made = folder.load_with(&of_views(2));
        let kind = made.as_ref().expect_err("is refused").kind();
        fails_with(made, kind, parts);
    };
    folder.write(path, header("float") + rows);
    failed(&["points3D.ply", "`view` has type"]);
    folder.write(path, header("int") + &rows.replace(" 2\n", " -2\n"));
    failed(&["vertex 1", "view -2 is below 0"]);
    folder.write(path, GOOD_PLY);
    failed(&["points3D.ply", "do not say which view", "name a cloud file"]);
    assert_eq!(n_cloud_views(folder.path(), &[]).expect("a cloud"), 0);
}

#[test]
fn points_of_test_views_are_left_out_of_a_cloud_that_names_its_views() {
    let names = ["a.png", "b b.png", "c.png", "d.png", "e.png", "f.png"];
    let folder = Folder::with_views(&names);
    folder.write(
        "split.json",
        r#"{"train": ["a.png", "c.png", "d.png", "e.png"], "test": ["b b.png"]}"#,
    );
    let cloud = PointCloud {
        positions: (0..6).map(|i| DVec3::new(f64::from(i), 0.0, 5.0)).collect(),
        colors: (0..6).map(|i| [i, 0, 0]).collect(),
        confidence: Some(vec![1.0; 6]),
    };
    let path = folder.path().join("sparse/0/points3D.ply");
    // A point of each view, backwards.
    write_cloud(&path, &cloud, &[5, 4, 3, 2, 1, 0], &names).expect("writes");
    let reds = |cloud: &PointCloud| cloud.colors.iter().map(|c| c[0]).collect::<Vec<u8>>();
    let scene = folder.scene();
    // That of the view that is not shown at all stays.
    assert_eq!(reds(&scene.cloud), [0, 1, 2, 3, 5]);
    let told = |scene: &Scene| {
        let said = |w: &&String| w.contains("1 of 6 points come from the depth of test views");
        scene.warnings.iter().filter(said).count()
    };
    assert_eq!(told(&scene), 1, "{:?}", scene.warnings);
    // The first training views: b is none.
    for (n, right) in [(1, &[5][..]), (2, &[3, 5]), (3, &[2, 3, 5])] {
        let options = LoadOptions {
            cloud: Some(CloudSource::Views(n)),
            ..options()
        };
        let scene = folder.load_with(&options).expect("a scene");
        assert_eq!(reds(&scene.cloud), right, "{n}");
        assert_eq!(told(&scene), 0);
    }
    let train = ["a.png", "c.png", "d.png", "e.png"];
    assert_eq!(n_cloud_views(folder.path(), &train).expect("a cloud"), 4);
    // A file named by hand is held to the same.
    let by_hand = LoadOptions {
        cloud: Some(CloudSource::File(path)),
        ..options()
    };
    let scene = folder.load_with(&by_hand).expect("a scene");
    assert_eq!((scene.cloud.len(), told(&scene)), (5, 1));
}

#[test]
fn a_scene_without_a_cloud_loads_where_none_is_needed() {
    let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
    let needless = LoadOptions {
        needs_cloud: false,
        ..options()
    };
    folder.remove("sparse/0/points3D.ply");
    // What `train` says names the command that makes one.
    folder.fails_with(&[
        "no point cloud",
        "gspotential scene --cameras",
        "--cloud dense.ply",
    ]);
    let scene = folder.load_with(&needless).expect("a scene");
    assert!(scene.cloud.is_empty() && scene.train.len() == 4);
    assert!(scene.source.contains("no cloud"), "{}", scene.source);
    warns(&scene, &[]);
    folder.write("sparse/0/points3D.bin", 0u64.to_le_bytes());
    folder.fails_with(&["no usable point", "gspotential scene --cameras"]);
    assert!(
        folder
            .load_with(&needless)
            .expect("a scene")
            .cloud
            .is_empty()
    );
    // One that is damaged is still told.
    folder.write("sparse/0/points3D.bin", &points_bin()[..20]);
    assert!(folder.load_with(&needless).is_err());
}

#[test]
fn a_random_cloud_fills_the_box_of_the_cloud_without_its_outliers() {
    let mut cloud = numbered(2001);
    cloud.positions[0] = DVec3::splat(-1e6);
    cloud.positions[2000] = DVec3::new(1e6, 5.0, 5.0);
    let random = random_like(&cloud, 3);
    assert_eq!((random.len(), random.colors.len()), (2001, 2001));
    assert_eq!(random.confidence, None);
    for axis in 0..3 {
        let mut values: Vec<f64> = random.positions.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        // The k-th of 2,000 uniform ones is within 3.5 standard deviations of its expectation.
        assert!(values[0] >= 19.0 && values[2000] <= 1981.0, "{values:?}");
        for k in [200, 1000, 1800] {
            let expected = 20.0 + 1960.0 * k as f64 / 2000.0;
            assert!((values[k] - expected).abs() < 77.0, "{k}: {}", values[k]);
        }
        let mean: f64 = random.colors.iter().map(|c| f64::from(c[axis])).sum();
        assert!((mean / 2001.0 - 127.5).abs() < 5.8, "{mean}");
    }
    assert_eq!(random, random_like(&cloud, 3));
    assert_ne!(random, random_like(&cloud, 4));
    assert!(random_like(&PointCloud::default(), 0).is_empty());
}

#[test]
fn the_built_in_scene_has_clouds_of_some_of_its_views_and_of_more() {
    let load = |cloud| {
        let options = LoadOptions {
            cloud,
            n_test: 0,
            ..options()
        };
        load_builtin(32, &options).expect("a scene").cloud
    };
    let own = load(None);
    let clouds: Vec<PointCloud> = (1..=8).map(|n| load(Some(CloudSource::Views(n)))).collect();
    assert_eq!(clouds[3], own);
    // Each view adds its points to those before.
    for pair in clouds.windows(2) {
        let n = pair[0].len();
        assert!(pair[1].len() > n && pair[1].positions[..n] == pair[0].positions[..]);
    }
    let random = load(Some(CloudSource::Random));
    assert_eq!(random, random_like(&own, options().seed));
}

#[test]
fn the_built_in_scene_alone_has_an_exact_cloud() {
    let exact: CloudSource = "exact".parse().expect("a cloud");
    assert_eq!(exact.to_string(), "exact");
    let with = |cloud| LoadOptions {
        cloud,
        n_test: 0,
        ..options()
    };
    let off = |cloud| {
        let cloud = load_builtin(32, &with(cloud)).expect("a scene").cloud;
        let distances = cloud.positions.iter().map(|p| surface_distance(*p).abs());
        (cloud.len(), distances.fold(0.0, f64::max))
    };
    // Every pixel of the four training views, 32x22.
    let (n, farthest) = off(Some(exact.clone()));
    assert_eq!(n, 4 * 32 * 22);
    assert!(farthest < 1e-4, "{farthest}");
    let (n, farthest) = off(None);
    assert!(n < 4 * 32 * 22 && farthest > 0.1, "{n}, {farthest}");

    let folder = Folder::with_views(&["a.png", "b.png"]);
    let refused = folder.load_with(&with(Some(exact)));
    fails_with(
        refused,
        ErrorKind::Usage,
        &["only the built-in scene", "--cloud"],
    );
}

/// Seconds since some day, as the time of change of a scene's file.
fn date(folder: &Folder, name: &str, seconds: u64) {
    let day = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000 + seconds);
    let file = std::fs::File::options()
        .append(true)
        .open(folder.path().join(name));
    file.and_then(|file| file.set_modified(day))
        .expect("a date");
}

#[test]
fn a_cloud_that_an_earlier_reconstruction_left_behind_is_told() {
    let text = |n: usize| {
        format!("# 3D point list\n# Number of points: {n}, mean track length: 2\n{POINTS_TXT}")
    };
    // The cloud that is taken has 3 points as PLY and 2 as COLMAP's.
    for (taken, beside, seconds, said) in [
        (
            "points3D.ply",
            ("points3D.bin", points_bin()),
            100,
            Some("`points3D.bin` beside `points3D.ply` is newer (2 beside 3)"),
        ),
        ("points3D.ply", ("points3D.bin", points_bin()), 30, None),
        (
            "points3D.ply",
            ("points3D.txt", text(2).into_bytes()),
            100,
            Some("`points3D.txt` beside `points3D.ply` is newer (2 beside 3)"),
        ),
        (
            "points3D.ply",
            ("points3D.txt", text(30).into_bytes()),
            0,
            Some("has far more points (30 beside 3)"),
        ),
        (
            "points3D.bin",
            ("points3D.txt", text(5).into_bytes()),
            100,
            Some("`points3D.txt` beside `points3D.bin` is newer (5 beside 2)"),
        ),
        // The same in another format, and one that is older.
        (
            "points3D.bin",
            ("points3D.txt", text(2).into_bytes()),
            100,
            None,
        ),
        (
            "points3D.bin",
            ("points3D.txt", text(5).into_bytes()),
            0,
            None,
        ),
    ] {
        let folder = Folder::with_views(&["a.png", "b.png", "c.png", "d.png"]);
        if taken != "points3D.ply" {
            folder.remove("sparse/0/points3D.ply");
            folder.write(&format!("sparse/0/{taken}"), points_bin());
        }
        let (name, bytes) = beside;
        folder.write(&format!("sparse/0/{name}"), bytes);
        date(&folder, &format!("sparse/0/{taken}"), 0);
        date(&folder, &format!("sparse/0/{name}"), seconds);
        let scene = folder.scene();
        assert!(scene.source.contains(taken), "{}", scene.source);
        match said {
            Some(part) => warns(&scene, &[part]),
            None => warns(&scene, &[]),
        }
    }
}
