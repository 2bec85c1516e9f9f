//! Disks that are full or read-only, files that vanish.

use std::fs;
use std::process::Command;

use gspotential::files::write_file;

use super::{Outcome, Place, ended, train, wait_until};
use crate::kit::program;
use crate::scene::build::Folder;

/// Runs a shell script in `place` with file systems of its own to mount; `$T` is the training and
/// `$G` the program.
#[track_caller]
fn in_own_mounts(place: &Place, script: &str) {
    let output = Command::new("unshare")
        .args(["--mount", "--map-root-user", "sh", "-euc", script])
        .env("G", program::PATH)
        .env(
            "T",
            format!("{} {}", program::PATH, train("--checkpoint-every 2")),
        )
        .current_dir(place.at(""))
        .output()
        .expect("a shell");
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{log}");
}

/// What the script has noted of a command that was to fail.
#[track_caller]
fn assert_failed(place: &Place, log: &str, parts: &[&str]) {
    let text = fs::read_to_string(place.at(log)).expect("a log");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    for part in parts {
        assert!(errors[0].contains(part), "no `{part}` in: {text}");
    }
}

fn undisturbed() -> Outcome {
    let place = Place::new();
    place.run(&train(""), 0);
    place.result()
}

#[test]
#[ignore = "needs mounts"]
fn a_full_disk_stops_the_training_and_room_lets_it_go_on() {
    let place = Place::new();
    let script = "mkdir disk; mount -t tmpfs -o size=400k none disk; cd disk
        code=0; $T 2>../log || code=$?; [ $code = 1 ]
        ls run/checkpoints/*.ckpt; [ ! -e run/metrics.json ]
        ! ls run/checkpoints/*.part
        mount -o remount,size=64m ../disk; $G train --resume run; cp -r run ..";
    in_own_mounts(&place, script);
    let parts = [
        "No space left on device",
        ".ckpt",
        "gspotential train --resume run",
    ];
    assert_failed(&place, "log", &parts);
    assert!(place.result() == undisturbed());
}

#[test]
#[ignore = "needs mounts"]
fn a_folder_that_turns_read_only_stops_the_training_and_keeps_the_last_checkpoint() {
    let place = Place::new();
    let script = "$T 2>log & until ls run/checkpoints/*.ckpt; do sleep 0.01; done 2>/dev/null
        mount --bind run run
        until mount -o remount,bind,ro run 2>/dev/null; do sleep 0.01; done # busy while it writes
        code=0; wait $! || code=$?; [ $code = 1 ]
        ls run/checkpoints/*.ckpt
        code=0; $G train --resume run 2>log2 || code=$?; [ $code = 1 ]
        umount run; $G train --resume run";
    in_own_mounts(&place, script);
    let parts = [
        "Read-only file system",
        ".ckpt",
        "gspotential train --resume run",
    ];
    assert_failed(&place, "log", &parts);
    assert_failed(&place, "log2", &["Read-only file system"]);
    assert!(place.result() == undisturbed());
}

#[test]
fn results_that_cannot_be_written_are_written_by_a_resumed_run() {
    let place = Place::new();
    let child = place.start(&train("--checkpoint-every 2"));
    wait_until("there is a checkpoint", || !place.checkpoints().is_empty());
    fs::create_dir(place.at("run/point_cloud.ply")).expect("a folder");
    let log = ended(child, 1);
    assert!(log.contains("point_cloud.ply: cannot write"), "{log}");
    assert!(
        place
            .checkpoints()
            .iter()
            .any(|path| path.ends_with("0000000060.ckpt"))
    );
    fs::remove_dir(place.at("run/point_cloud.ply")).expect("removed");
    place.run("train --resume run", 0);
    assert!(place.result() == undisturbed());
}

#[test]
fn a_run_that_is_removed_meanwhile_is_not_brought_back() {
    let place = Place::new();
    let child = place.start(&train("--checkpoint-every 2"));
    wait_until("there is a checkpoint", || !place.checkpoints().is_empty());
    fs::rename(place.at("run"), place.at("elsewhere")).expect("moved");
    let log = ended(child, 1);
    assert!(log.contains(".ckpt: cannot write"), "{log}");
    assert!(!place.at("run").exists());
    place.run("train --resume elsewhere", 0);
    assert!(Outcome::of(&place.at("elsewhere")) == undisturbed());
}

#[test]
fn a_scene_that_is_removed_meanwhile_is_not_missed() {
    let place = Place::new();
    let scene = Folder::with_views(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    let path = scene.path().to_str().expect("a path in UTF-8").to_owned();
    let settings = "--preset 3dgs --set densify.enabled=false --iterations 60 --checkpoint-every 2";
    let child = place.start(&format!("train --scene {path} {settings} --out run"));
    wait_until("there is a checkpoint", || !place.checkpoints().is_empty());
    drop(scene);
    ended(child, 0);
    assert!(place.at("run/metrics.json").exists());
    // What was measured still counts; measuring it again is another matter.
    place.run("eval run", 0);
    let log = place.run("eval run --again", 1);
    assert!(log.contains(&path), "{log}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_write_without_room_names_the_file_and_leaves_the_old_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("metrics.json");
    write_file(&path, b"old").expect("written");
    let neighbor = folder.path().join("metrics.json.part");
    std::os::unix::fs::symlink("/dev/full", &neighbor).expect("a link");
    let error = write_file(&path, b"new").unwrap_err().to_string();
    assert!(
        error.contains("metrics.json: cannot write: No space left"),
        "{error}"
    );
    assert_eq!(fs::read(&path).expect("a file"), b"old");
    assert!(!neighbor.is_symlink(), "the neighbour is left");
    write_file(&path, b"new").expect("there is room again");
}
