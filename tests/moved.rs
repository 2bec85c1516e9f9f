//! `eval --scene`: a run whose scene has moved.

use gspotential::scene::Scene;

use crate::kit::program::{run, succeed};
use crate::scene::build::Folder;
use crate::scene::fixtures::{still_life, vggt};

/// The scene with a change, in a folder of its own.
fn changed(change: impl Fn(&mut Scene)) -> Folder {
    let mut scene = still_life();
    change(&mut scene);
    vggt(&scene)
}

#[test]
fn a_scene_that_has_moved_is_measured_and_another_is_refused_by_what_differs() {
    let place = tempfile::tempdir().expect("a folder");
    let before = changed(|_| {});
    let source = before.path().to_str().expect("UTF-8");
    let train = "train --iterations 1 --preset 3dgs --max-points 50 --out run --scene";
    let args: Vec<&str> = train.split(' ').chain([source]).collect();
    let trained = succeed(place.path(), &args[..]).stdout;
    drop(before);
    // Gone from where it was, it can't be measured again without a word on where it is.
    let output = run(place.path(), &["eval", "run", "--again"]);
    let error = output.log;
    assert_eq!(output.code, Some(1), "{error}");
    assert!(error.contains("--scene DIR"), "{error}");

    let eval = |scene: &Folder| {
        let dir = scene.path().to_str().expect("UTF-8");
        run(place.path(), &["eval", "run", "--again", "--scene", dir])
    };
    let output = eval(&changed(|_| {}));
    assert_eq!(output.code, Some(0), "{}", output.log);
    assert_eq!(output.stdout.trim(), trained.trim());

    let refused = |change: fn(&mut Scene), what: &str| {
        let output = eval(&changed(change));
        let error = output.log;
        assert_eq!(output.code, Some(1), "{error}");
        assert!(error.contains(what), "no `{what}` in: {error}");
    };
    refused(
        |s| s.cloud.positions[7].x += 0.01,
        "its cloud has other points",
    );
    refused(|s| s.cloud.colors[7][1] ^= 1, "its cloud has other points");
    let fewer = |s: &mut Scene| {
        let kept: Vec<bool> = (0..s.cloud.len()).map(|i| i > 0).collect();
        s.cloud.retain(&kept);
    };
    refused(fewer, "points and had");
    refused(|s| s.test[0].camera.fx *= 1.01, "has another lens");
    refused(
        |s| s.test[0].camera.translation.x += 0.01,
        "is taken from elsewhere",
    );
    refused(
        |s| s.train[1].camera.translation.y += 0.01,
        "is taken from elsewhere",
    );
    refused(
        |s| s.test[0].camera.name = "other.png".to_owned(),
        "is not in the scene",
    );

    let nowhere = run(place.path(), &["eval", "run", "--scene", "nowhere"]);
    assert!(nowhere.log.contains("cannot open the scene"));
}
