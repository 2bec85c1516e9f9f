//! Several processes at once.

use std::fs;

use gspotential::run::RunDir;

use super::{Place, ended, endless_train, train, wait_until};

#[test]
fn a_second_process_on_one_run_is_refused_until_the_first_is_gone_however_it_went() {
    let place = Place::new();
    let mut first = place.start(&endless_train("--checkpoint-every 5"));
    wait_until("there is a checkpoint", || !place.checkpoints().is_empty());
    for args in [&train("--overwrite"), "train --resume run"] {
        let log = place.run(args, 1);
        assert!(
            log.contains("run: another gspotential is at work"),
            "{args}: {log}"
        );
    }
    let log = place.run(&train(""), 1);
    assert!(
        log.contains("--overwrite") && log.contains("--resume"),
        "{log}"
    );
    assert!(
        first.try_wait().expect("a status").is_none(),
        "the first has ended"
    );
    first.kill().expect("killed");
    first.wait().expect("ended");
    // The file is still there, its lock is not.
    assert!(place.at("run/.lock").exists());
    place.run(&train("--overwrite"), 0);
    let log = place.run("train --resume run", 0);
    assert!(
        log.contains("run is finished; nothing is left to do"),
        "{log}"
    );
}

#[test]
fn a_run_that_is_written_is_not_measured_and_one_that_is_not_finished_says_so() {
    let place = Place::new();
    place.run(&train(""), 0);
    place.run("eval run --again", 0);
    let held = RunDir::claim(&place.at("run")).expect("a run");
    let log = place.run("eval run --again", 1);
    assert!(log.contains("another gspotential"), "{log}");
    // What is up to date is only read.
    place.run("eval run", 0);
    drop(held);
    place.run("eval run --again", 0);
    fs::remove_file(place.at("run/metrics.json")).expect("removed");
    let log = place.run("eval run", 1);
    assert!(
        log.contains("not finished; go on with `gspotential train --resume run`"),
        "{log}"
    );
}

#[test]
fn two_that_start_at_once_in_one_folder_leave_one_whole_run() {
    let place = Place::new();
    let started = [place.start(&train("")), place.start(&train(""))];
    let mut logs = Vec::new();
    for child in started {
        let output = child.wait_with_output().expect("the command ends");
        let log = String::from_utf8_lossy(&output.stderr).into_owned();
        logs.push((output.status.code(), log));
    }
    logs.sort();
    let codes = [logs[0].0, logs[1].0];
    assert_eq!(codes, [Some(0), Some(1)], "{logs:?}");
    let refusal = &logs[1].1;
    let refused = refusal.contains("another gspotential") || refusal.contains("is not empty");
    assert!(refused, "{refusal}");
    let alone = Place::new();
    alone.run(&train(""), 0);
    assert!(place.result() == alone.result());
}

#[test]
fn two_trainings_share_an_adapter() {
    let places = [Place::new(), Place::new()];
    let started = places.each_ref().map(|place| place.start(&train("")));
    for child in started {
        ended(child, 0);
    }
    assert!(places[0].result() == places[1].result());
}
