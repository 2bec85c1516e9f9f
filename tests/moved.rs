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

    let no_other = "has another photograph or mask";
    refused(
        |s| s.test[0].image.rgb.iter_mut().for_each(|v| *v = 255 - *v),
        no_other,
    );
    refused(
        |s| {
            let other = s.train[1].image.clone();
            s.train[1].image = std::mem::replace(&mut s.train[0].image, other);
        },
        no_other,
    );
    // Something that was moved within the photograph.
    refused(|s| s.train[0].image.rgb[..600].fill(0), no_other);
    // Another program's rounding.
    let output = eval(&changed(|s| {
        let values = s.train.iter_mut().flat_map(|v| &mut v.image.rgb);
        values.for_each(|v| *v ^= 1);
    }));
    assert_eq!(output.code, Some(0), "{}", output.log);

    let nowhere = run(place.path(), &["eval", "run", "--scene", "nowhere"]);
    assert!(nowhere.log.contains("cannot open the scene"));
}

#[test]
fn a_run_within_its_scene_is_no_part_of_it() {
    let scene = changed(|_| {});
    let train = |out: &str| {
        let train = "train --iterations 1 --preset 3dgs --max-points 50 --scene . --out";
        let log = succeed(scene.path(), &format!("{train} {out}")).log;
        let model = std::fs::read(scene.path().join(out).join("point_cloud.ply"));
        (model.expect("a model"), log)
    };
    // Images and masks might lie there, too.
    let (first, _) = train("images/run");
    let (second, log) = train("run");
    assert!(first == second);
    assert!(!log.contains("have no pose"), "{log}");
    // What was measured is still what is there.
    let log = succeed(scene.path(), "eval images/run run").log;
    assert!(!log.contains("evaluation:"), "{log}");
    let log = succeed(scene.path(), "eval run --again").log;
    assert!(log.contains("evaluation:"), "{log}");
}
