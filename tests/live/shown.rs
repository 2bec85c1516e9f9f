//! What the page shows, and when training is asked for the Gaussians.

use std::sync::Arc;
use std::time::Duration;

use gspotential::camera::Frame;
use gspotential::config::Config;
use gspotential::live::{Live, Phase, Subject};
use gspotential::report::Course;
use gspotential::scene::{PointCloud, PoseProtocol, Scene};
use gspotential::train::{ImageLoss, LossSample, SignalPoint};

use super::get;
use crate::page::content::HOSTILE;
use crate::page::{ball, camera, metrics, photograph};

/// A page with two training views and one to test.
pub(super) fn page(test: &str) -> Live {
    let live = Live::serve(0).expect("serves");
    let view = |name: &str| photograph(name);
    live.photographs(Arc::new(Scene {
        name: "scene".into(),
        source: String::new(),
        train: vec![view("a.png"), view("b.png")],
        test: vec![view(test)],
        cloud: PointCloud::default(),
        whole_cloud: None,
        pose_protocol: PoseProtocol::SharedFrame,
        warnings: Vec::new(),
    }));
    live.subject(Subject {
        name: "run".into(),
        cameras: vec![
            camera("a.png", 0.0),
            camera("b.png", 0.8),
            camera(test, 0.4),
        ],
        frame: Frame::IDENTITY,
        config: Config::preset("paper").expect("a preset"),
        scene: Some(metrics(test).scene),
    });
    live.course(Course::default(), 0);
    live.phase(Phase::Training);
    live
}

/// A look at the losses after so many iterations.
pub(super) fn look(live: &Live, iteration: u32) {
    let part = ImageLoss { l1: 0.1, ssim: 0.7 };
    let sample = LossSample {
        iteration,
        loss: 0.25,
        real: part,
        virt: None,
        depths: None,
    };
    live.look(&sample, 1, 75.0);
}

#[test]
fn gaussians_are_due_only_if_a_browser_has_asked_and_not_at_once_again() {
    let live = page("t.png");
    assert!(!live.is_due());
    assert_eq!(get(&live, "state").json()["model"], 0);
    assert!(live.is_due());
    live.show(10, ball(), Duration::ZERO);
    assert!(!live.is_due());
    let state = get(&live, "state").json();
    assert_eq!(
        (&state["model"], &state["model_iteration"]),
        (&1.into(), &10.into())
    );
    assert_eq!(get(&live, "gaussians").body.len(), 16);
    assert!(!live.is_due(), "not before its time has come");
    std::thread::sleep(Duration::from_millis(3100));
    assert!(live.is_due());
    // What was dear is not done again for a long time.
    live.show(20, ball(), Duration::from_secs(1));
    get(&live, "state");
    std::thread::sleep(Duration::from_millis(3100));
    assert!(!live.is_due());
}

#[test]
fn a_page_waits_for_its_scene_and_then_follows_the_training() {
    let waiting = Live::serve(0).expect("serves");
    let state = get(&waiting, "state").json();
    assert_eq!(
        (&state["phase"], &state["has_scene"]),
        (&"loading".into(), &false.into())
    );
    assert_eq!(get(&waiting, "").status, 200);

    let live = page("t.png");
    live.ends(100);
    assert_eq!(get(&live, "curves").json(), serde_json::json!([]));
    look(&live, 10);
    live.measured(&SignalPoint {
        iteration: 10,
        n_gaussians: 1,
        held_out: 17.5,
        photographs: None,
    });
    let state = get(&live, "state").json();
    for (key, value) in [
        ("phase", serde_json::json!("training")),
        ("done", 10.into()),
        ("total", 100.into()),
        ("seconds_left", 75.0.into()),
        ("loss", 0.25.into()),
        ("held_out", 17.5.into()),
        ("gaussians", 1.into()),
    ] {
        assert_eq!(state[key], value, "{key}: {state}");
    }
    // Loss, size and what the held-out views say.
    let curves = get(&live, "curves").json();
    assert_eq!(curves.as_array().expect("a list").len(), 3);
    live.phase(Phase::Finished);
    assert_eq!(get(&live, "state").json()["phase"], "finished");
}

#[test]
fn each_view_has_its_photograph_and_names_are_escaped() {
    let live = page(HOSTILE);
    let page = String::from_utf8(get(&live, "").body).expect("text");
    assert!(!page.contains("<script>document.title"), "{page}");
    assert_eq!(page.matches("<figure data-camera").count(), 3);
    for number in 0..3 {
        assert!(page.contains(&format!("src=\"photograph-{number}\"")));
        let photograph = get(&live, &format!("photograph-{number}"));
        assert!(
            photograph.head.contains("image/jpeg"),
            "{}",
            photograph.head
        );
        let decoded = image::load_from_memory(&photograph.body).expect("a picture");
        assert_eq!((decoded.width(), decoded.height()), (60, 40));
    }
    assert_eq!(get(&live, "photograph-3").status, 404);
}
