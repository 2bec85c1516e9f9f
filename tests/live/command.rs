//! `train --watch` and `view` as a user starts them.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Stdio};

use gspotential::camera::Frame;
use gspotential::error::ErrorKind;
use gspotential::eval::EvalOptions;
use gspotential::gaussians::ply::write_ply;
use gspotential::gpu::Gpu;
use gspotential::live::Live;
use gspotential::pipeline::{self, GoOn, TrainJob};
use gspotential::run::{RunDir, Stop};

use super::{ask, get, parts};
use crate::faults::job;
use crate::gaussians_ply::distinct;
use crate::kit::program::{command, run, succeed};
use crate::page::finished;

const TINY: &str = "train --scene builtin:32 --iterations 400 --set views.count=6 \
                    --set scene.n_test=2 --max-points 300";

/// Starts the program, which serves a page, and returns its address and what it writes after it.
fn start(folder: &Path, args: &str) -> (Child, String, BufReader<impl Read + use<>>) {
    let mut child = command(folder, args)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut log = BufReader::new(child.stderr.take().expect("is piped"));
    let mut line = String::new();
    log.read_line(&mut line).expect("a line");
    let address = match line.strip_prefix("page: ") {
        Some(address) => address.trim().to_owned(),
        None => serde_json::from_str::<serde_json::Value>(&line).expect("an object")["address"]
            .as_str()
            .expect("an address")
            .to_owned(),
    };
    (child, address, log)
}

#[test]
fn a_watched_training_ends_in_the_same_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    succeed(folder.path(), &format!("{TINY} --quiet --out alone"));
    // Quiet or not, the address is said.
    let watched = format!("{TINY} --quiet --out watched --watch");
    let (mut child, address, _log) = start(folder.path(), &watched);
    let (mut phases, mut n_models) = (Vec::new(), 0);
    // It answers until it ends.
    while let Some(state) = ask(&address, "state") {
        let state = state.json();
        let model = state["model"].as_u64().expect("a number");
        if model > n_models {
            n_models = model;
            assert!(ask(&address, "gaussians").is_none_or(|answer| answer.status == 200));
        }
        if phases.last() != Some(&state["phase"]) {
            phases.push(state["phase"].clone());
        }
    }
    assert!(child.wait().expect("ends").success());
    // One on the way at least, and the last.
    assert!(n_models >= 2, "{n_models}: {phases:?}");
    assert!(phases.contains(&"training".into()), "{phases:?}");
    let cloud = |run: &str| std::fs::read(folder.path().join(run).join("point_cloud.ply"));
    assert!(cloud("alone").expect("a cloud") == cloud("watched").expect("a cloud"));
}

#[test]
fn a_training_that_goes_on_is_watched_from_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("run");
    let job = job();
    let stop = Stop::unheard();
    stop.ask();
    let run = RunDir::create(&root, &job.config, false).expect("is created");
    let (gpu, scene) = (Gpu::open().expect("opens"), job.load().expect("loads"));
    let options = EvalOptions::default();
    let so_far = Default::default();
    let stopped = pipeline::train(&gpu, &scene, &job, so_far, &options, &run, &stop);
    assert_eq!(
        stopped.expect_err("is stopped").kind(),
        ErrorKind::Interrupted
    );
    drop(run);

    let live = Live::serve(0).expect("serves");
    let how = GoOn {
        watch: Some(live.clone()),
        ..GoOn::default()
    };
    TrainJob::resume(&root, how, &options).expect("goes on");
    let state = get(&live, "state").json();
    assert_eq!(state["phase"], "finished");
    assert_eq!(state["done"], state["total"]);
    assert!(
        state["test"].as_f64().is_some_and(f64::is_finite),
        "{state}"
    );
    let n_views = scene.train.len() + scene.test.len();
    assert_eq!(
        get(&live, &format!("photograph-{}", n_views - 1)).status,
        200
    );
}

#[test]
fn the_address_is_an_object_among_objects() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = finished(&folder.path().join("run"), "t.png");
    let args = format!("view {} --log json", run.root().display());
    let (mut child, address, _log) = start(folder.path(), &args);
    assert!(address.starts_with("http://127.0.0.1:"), "{address}");
    child.kill().expect("ends");
    child.wait().expect("ends");
}

#[test]
fn a_finished_run_and_a_file_are_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = finished(&folder.path().join("run"), "t.png");
    let path = folder.path().join("model.ply");
    write_ply(&path, &distinct(2, 0), &Frame::IDENTITY).expect("is written");
    let run = run.root().display().to_string();
    for (model, name, n_gaussians) in [
        (run.as_str(), "<h1>run</h1>", 1),
        ("model.ply", "<h1>model.ply</h1>", 2),
    ] {
        let (mut child, address, _log) = start(folder.path(), &format!("view {model}"));
        let state = loop {
            let state = ask(&address, "state").expect("an answer").json();
            if state["phase"] == "finished" {
                break state;
            }
        };
        let page = String::from_utf8(ask(&address, "").expect("a page").body).expect("text");
        assert!(page.contains(name), "{page}");
        assert_eq!(state["model_gaussians"], n_gaussians);
        let packed = ask(&address, "gaussians").expect("Gaussians");
        assert_eq!(packed.body.len(), 16 * n_gaussians);
        child.kill().expect("ends");
        child.wait().expect("ends");
    }
}

#[test]
fn what_cannot_be_served_or_shown_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let busy = Live::serve(0).expect("serves");
    let port = parts(busy.address()).0.rsplit_once(':').expect("a port").1;
    std::fs::create_dir(folder.path().join("empty")).expect("is created");
    std::fs::write(folder.path().join("text.ply"), "no ply").expect("is written");
    for (args, code, part) in [
        (
            format!("train --watch {port}"),
            1,
            format!("port {port} of 127.0.0.1"),
        ),
        ("train --watch 65536".to_owned(), 2, "65536".to_owned()),
        ("train --watch -1".to_owned(), 2, "-1".to_owned()),
        (
            "train --watch --dry-run".to_owned(),
            2,
            "--dry-run".to_owned(),
        ),
        ("view nowhere".to_owned(), 1, "nowhere".to_owned()),
        (
            "view empty".to_owned(),
            1,
            "is not a run directory".to_owned(),
        ),
        ("view text.ply".to_owned(), 1, "text.ply".to_owned()),
        (
            "view text.ply --port 70000".to_owned(),
            2,
            "70000".to_owned(),
        ),
    ] {
        let ended = run(folder.path(), &args);
        assert_eq!(ended.code, Some(code), "{args}: {}", ended.log);
        assert!(ended.log.contains(&part), "{args}: {}", ended.log);
    }
    assert!(!folder.path().join("runs").exists());
}
