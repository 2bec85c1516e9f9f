//! The split into training and test views.

use super::build::{Folder, fails_with, options, warns};
use gspotential::error::ErrorKind;
use gspotential::scene::{LoadOptions, Scene, View, load_builtin};

fn names(views: &[View]) -> String {
    let stems: Vec<_> = views
        .iter()
        .map(|v| v.camera.name.trim_end_matches(".png"))
        .collect();
    stems.join(" ")
}

#[track_caller]
fn is_split(scene: &Scene, train: &str, test: &str) {
    assert_eq!(names(&scene.train), train);
    assert_eq!(names(&scene.test), test);
}

fn letters(n: usize) -> Folder {
    let names: Vec<String> = ('a'..='z').take(n).map(|c| format!("{c}.png")).collect();
    // Unsorted, as some writers leave them.
    let names: Vec<&str> = names.iter().rev().map(String::as_str).collect();
    Folder::with_views(&names)
}

fn trained_on(names: &[&str]) -> LoadOptions {
    LoadOptions {
        train_views: Some(names.iter().map(|name| format!("{name}.png")).collect()),
        ..options()
    }
}

#[test]
fn the_protocol_takes_views_uniformly_over_the_sorted_names() {
    // Indices 0, 3, 6, 9 of 10; then 0 2.5 5 of the six left, halves rounded up.
    let folder = letters(10);
    let counts = |n_train, n_test| LoadOptions {
        n_train,
        n_test,
        ..options()
    };
    let split = |n_train, n_test| folder.load_with(&counts(n_train, n_test)).expect("a scene");
    is_split(&split(4, 60), "a d g j", "b c e f h i");
    is_split(&split(4, 3), "a d g j", "b f i");
    is_split(&split(3, 1), "a f j", "b");
    is_split(&split(1, 2), "a", "b j");
    is_split(&split(4, 0), "a d g j", "");
    is_split(&split(10, 60), "a b c d e f g h i j", "");
    let more = split(11, 60);
    is_split(&more, "a b c d e f g h i j", "");
    warns(&more, &["only 10 posed images for 11 training views"]);
    fails_with(
        folder.load_with(&counts(0, 60)),
        ErrorKind::Usage,
        &["0 training views"],
    );
}

/// `n` views at the places that `at` gives, all with the same orientation.
fn placed(n: usize, at: impl Fn(usize) -> [f64; 3]) -> Folder {
    let folder = letters(n);
    let lines: Vec<String> = ('a'..='z')
        .take(n)
        .enumerate()
        .map(|(i, name)| {
            let [x, y, z] = at(i).map(|v| -v);
            format!("{} 1 0 0 0 {x} {y} {z} 1 {name}.png\n\n", i + 1)
        })
        .collect();
    folder.write("sparse/0/images.txt", lines.concat());
    folder
}

#[test]
fn a_closed_loop_is_split_around_and_an_open_sequence_from_end_to_end() {
    let turn = |i: usize, n: usize, share: f64| {
        let (sin, cos) = (share * i as f64 * std::f64::consts::TAU / n as f64).sin_cos();
        [3.0 * cos, 3.0 * sin, 0.1 * (i % 3) as f64]
    };
    let train = |folder: &Folder, n_train: usize| {
        let counts = LoadOptions {
            n_train,
            ..options()
        };
        names(&folder.load_with(&counts).expect("a scene").train)
    };
    let closed = placed(12, |i| turn(i, 12, 1.0));
    assert_eq!(train(&closed, 4), "a d g j");
    assert_eq!(train(&closed, 2), "a g");
    assert_eq!(train(&closed, 1), "a");
    assert_eq!(train(&closed, 12), "a b c d e f g h i j k l");
    // Three quarters of a turn, a line, one place, places without an order.
    let open = placed(12, |i| turn(i, 12, 0.75));
    assert_eq!(train(&open, 4), "a e h l");
    assert_eq!(train(&placed(12, |i| [i as f64, 0.0, 0.0]), 4), "a e h l");
    assert_eq!(train(&placed(12, |_| [0.0; 3]), 4), "a e h l");
    assert_eq!(train(&placed(12, |i| turn(i * 5, 12, 1.0)), 4), "a e h l");
    // Names and the split file go before.
    closed.write("split.json", r#"{"train": ["a.png", "l.png"]}"#);
    assert_eq!(train(&closed, 4), "a l");
}

#[test]
fn the_split_file_is_followed_in_its_order() {
    let folder = letters(6);
    folder.write(
        "split.json",
        r#"{"train": ["e.png", "b.png"], "test": ["f.png", "a.png"]}"#,
    );
    is_split(&folder.scene(), "e b", "f a");
    folder.write("split.json", r#"{"train": ["e.png", "b.png"]}"#);
    is_split(&folder.scene(), "e b", "a c d f");
    folder.write("split.json", r#"{"train": ["e.png", "b.png"], "test": []}"#);
    is_split(&folder.scene(), "e b", "");
}

#[test]
fn named_training_views_come_before_the_split_file() {
    let folder = letters(6);
    is_split(
        &folder.load_with(&trained_on(&["c", "a"])).expect("a scene"),
        "c a",
        "b d e f",
    );
    folder.write(
        "split.json",
        r#"{"train": ["e.png", "b.png"], "test": ["f.png", "a.png"]}"#,
    );
    let scene = folder.load_with(&trained_on(&["c", "a"])).expect("a scene");
    is_split(&scene, "c a", "f");
    warns(&scene, &["1 test views of `split.json` are trained on"]);
}

#[test]
fn named_test_views_come_before_the_split_file_and_are_checked_like_training_views() {
    let folder = letters(6);
    let tested_on = |names: &[&str]| LoadOptions {
        test_views: Some(names.iter().map(|name| format!("{name}.png")).collect()),
        ..trained_on(&["c", "a"])
    };
    for file in [
        None,
        Some(r#"{"train": ["e.png"], "test": ["f.png", "a.png"]}"#),
    ] {
        if let Some(json) = file {
            folder.write("split.json", json);
        }
        let scene = folder.load_with(&tested_on(&["f", "b"])).expect("a scene");
        is_split(&scene, "c a", "f b");
        warns(&scene, &[]);
        is_split(
            &folder.load_with(&tested_on(&[])).expect("a scene"),
            "c a",
            "",
        );
        for (names, part) in [
            (
                &["b", "c"][..],
                "`c.png` is named for training and for testing",
            ),
            (&["b", "b"], "test view `b.png` is named twice"),
            (&["q"], "test view `q.png` is not in the scene"),
        ] {
            let loaded = folder.load_with(&tested_on(names));
            fails_with(loaded, ErrorKind::Usage, &[part]);
        }
        // Views in both lists are there twice, where that is asked for.
        let both = LoadOptions {
            overlap: true,
            ..tested_on(&["b", "c"])
        };
        let scene = folder.load_with(&both).expect("a scene");
        is_split(&scene, "c a", "b c");
        assert_eq!(scene.n_test_trained(), 1);
        assert_eq!(scene.train[0].image, scene.test[1].image);
    }
}

#[test]
fn the_built_in_scene_is_split_by_names_as_well() {
    let named = |train: Option<&[&str]>, test: Option<&[&str]>| {
        let owned = |names: &[&str]| names.iter().map(|name| format!("{name}.png")).collect();
        let options = LoadOptions {
            train_views: train.map(owned),
            test_views: test.map(owned),
            n_test: 3,
            ..options()
        };
        load_builtin(16, &options)
    };
    let scene = named(Some(&["test_01", "train_02"]), None).expect("a scene");
    is_split(&scene, "test_01 train_02", "test_00 test_02");
    let scene = named(None, Some(&["test_02"])).expect("a scene");
    is_split(&scene, "train_00 train_01 train_02 train_03", "test_02");
    for (train, test, part) in [
        (&["train_04"][..], None, "did you mean `train_00.png`"),
        (&["train_01", "train_01"], None, "named twice"),
        (&[], None, "no training view"),
        (
            &["test_00"],
            Some(&["test_00"][..]),
            "for training and for testing",
        ),
    ] {
        fails_with(named(Some(train), test), ErrorKind::Usage, &[part]);
    }
}

#[test]
fn unknown_training_views_are_usage_errors_with_a_suggestion() {
    let folder = Folder::with_views(&["IMG_0001.png", "IMG_0002.png", "IMG_0003.png", "house.png"]);
    let refused = |names: &[&str], parts: &[&str]| {
        fails_with(
            folder.load_with(&trained_on(names)),
            ErrorKind::Usage,
            parts,
        );
    };
    refused(
        &["IMG_0001", "huose"],
        &[
            "`huose.png` is not in the scene",
            "did you mean `house.png`?",
        ],
    );
    refused(&["IMG-0002"], &["did you mean `IMG_0002.png`"]);
    refused(&["x/y/z/w"], &["views are named like"]);
    refused(&[&"long".repeat(100_000)[..700]], &["is not in the scene"]);
    refused(&["house", "house"], &["`house.png` is named twice"]);
    refused(&[], &["no training view is named"]);
}

#[test]
fn training_views_without_pose_or_image_are_refused() {
    let folder = letters(6);
    folder.remove("images/c.png");
    folder.write("images/z.png", super::build::png(2, 2));
    for (name, part) in [
        ("c", "has a pose but no image"),
        ("z", "has an image but no pose"),
    ] {
        fails_with(
            folder.load_with(&trained_on(&["a", name])),
            ErrorKind::Usage,
            &[part],
        );
        folder.write(
            "split.json",
            format!(r#"{{"train": ["a.png", "{name}.png"]}}"#),
        );
        folder.fails_with(&["split.json: training view", part]);
    }
}

#[test]
fn bad_split_files_are_named() {
    let folder = letters(6);
    for (json, part) in [
        ("", "line 1"),
        ("[]", "not a split file"),
        // A line break and a terminal code of the file's in the message.
        (r#"{"tra\n\u001b[2J": 1}"#, "unknown field `tra [2J`"),
        (r#"{"test": ["a.png"]}"#, "missing field `train`"),
        (
            r#"{"train": ["a.png"], "tests": []}"#,
            "unknown field `tests`",
        ),
        (r#"{"train": "a.png"}"#, "not a split file"),
        (r#"{"train": []}"#, "no training view"),
        (r#"{"train": ["a.png", "a.png"]}"#, "`a.png` is named twice"),
        (
            r#"{"train": ["a.png", "q.png"]}"#,
            "`q.png` is not in the scene",
        ),
        (r#"{"train": ["a.png"], "test": ["a.png"]}"#, "in both"),
        (r#"{"train": ["../a.png"]}"#, "is not in the scene"),
    ] {
        folder.write("split.json", json);
        folder.fails_with(&["split.json: ", part, "; "]);
    }
}

#[test]
fn test_views_that_cannot_be_used_are_counted() {
    let folder = letters(6);
    folder.remove("images/c.png");
    folder.write(
        "split.json",
        r#"{"train": ["a.png"], "test": ["c.png", "b.png", "x.png", "b.png", "d.png"]}"#,
    );
    let scene = folder.scene();
    is_split(&scene, "a", "b d");
    warns(
        &scene,
        &[
            "1 poses have no image",
            "2 test views of `split.json` have no posed image and are left out: `c.png`, ...",
            "1 test views of `split.json` are named again",
        ],
    );
}
