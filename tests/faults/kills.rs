//! Runs that are ended at any moment and resumed.

use std::process::Command;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Place, ended, endless_train, train, wait_until};

/// Kills in a usual test run; `GSPOTENTIAL_KILLS` asks for more.
const N_KILLS: usize = 5;

/// Counts of where the kills fell.
#[derive(Debug, Default)]
struct Tally {
    before_training: usize,
    before_a_checkpoint: usize,
    while_writing_one: usize,
    between_two: usize,
    after_the_last: usize,
    runs_finished: usize,
}

impl Tally {
    fn add(&mut self, place: &Place) {
        let writing = !place.files("run/checkpoints", ".part").is_empty();
        let newest = place.checkpoints().pop();
        *match newest {
            _ if !place.at("run/checkpoints/job.json").exists() => &mut self.before_training,
            _ if writing => &mut self.while_writing_one,
            None => &mut self.before_a_checkpoint,
            Some(path) if path.ends_with("0000000060.ckpt") => &mut self.after_the_last,
            Some(_) => &mut self.between_two,
        } += 1;
    }

    fn kills(&self) -> usize {
        self.before_training
            + self.before_a_checkpoint
            + self.while_writing_one
            + self.between_two
            + self.after_the_last
    }
}

/// Goes on with the run however far it has come.
fn next(place: &Place) -> String {
    let has = |name: &str| place.at("run").join(name).exists();
    if has("checkpoints/job.json") || has("metrics.json") {
        "train --resume run".to_owned()
    } else {
        train("--checkpoint-every 1 --overwrite")
    }
}

#[test]
fn a_run_killed_at_random_moments_ends_as_one_left_alone() {
    let n_kills = std::env::var("GSPOTENTIAL_KILLS");
    let n_kills = n_kills.map_or(N_KILLS, |n| n.parse().expect("a number"));
    let alone = Place::new();
    let start = Instant::now();
    alone.run(&train("--checkpoint-every 1"), 0);
    let longest = start.elapsed();
    let alone = alone.result();

    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut tally = Tally::default();
    let mut place = Place::new();
    loop {
        let mut child = place.start(&next(&place));
        let last = tally.kills() == n_kills;
        if !last {
            std::thread::sleep(longest.mul_f64(rng.random_range(0.0..1.1)));
        }
        if last || child.try_wait().expect("a status").is_some() {
            ended(child, 0);
            assert!(place.result() == alone, "differs after {tally:?}");
            tally.runs_finished += 1;
            if last {
                break;
            }
            place = Place::new();
        } else {
            child.kill().expect("killed");
            child.wait().expect("ended");
            tally.add(&place);
        }
    }
    println!("{tally:?}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_and_sigterm_save_the_state_and_say_how_to_go_on() {
    let place = Place::new();
    let newest = || place.checkpoints().pop();
    // Signals the command once it has written a checkpoint; returns where it stopped, and its log.
    let stop = |args: &str, signal: &str| -> (u32, String) {
        let before = newest();
        let child = place.start(args);
        wait_until("there is a new checkpoint", || newest() > before);
        let kill = format!("kill -{signal} {}", child.id());
        let sent = Command::new("sh").args(["-c", &kill]).status();
        assert!(sent.expect("a shell").success());
        let log = ended(child, 130);
        let (_, message) = log.rsplit_once("stopped: after iteration ").expect(&log);
        let (done, way_out) = message.split_once(" of 1000000; ").expect(&log);
        assert_eq!(
            way_out.trim(),
            "go on with `gspotential train --resume run`"
        );
        let last = newest().expect("a checkpoint");
        assert!(last.ends_with(format!("{done:0>10}.ckpt")), "{last:?}");
        (done.parse().expect("a number"), log)
    };
    let (first, _) = stop(&endless_train("--checkpoint-every 20"), "INT");
    let (second, log) = stop("train --resume run", "TERM");
    assert!(second > first, "{first}, {second}");
    assert!(
        log.contains(&format!("going on after iteration {first} of")),
        "{log}"
    );
    assert_eq!(place.checkpoints().len(), 2);
    assert!(!place.at("run/metrics.json").exists());
}
