//! The state of a training in progress: whole, and every part of it needed.

use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::train::{State, Trainer};

use super::job;
use crate::gpu::rig::context;
use crate::kit::keep::{Keep, same};

#[test]
fn a_state_goes_on_as_the_run_it_is_of_and_no_part_of_it_is_idle() {
    let ctx = context();
    let job = job();
    let scene = job.load().expect("a scene");
    let prepared = prepare(&scene, &job.config, &mut Seconds::default()).expect("a sphere");
    let trainer = || {
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &job.config).expect("fits")
    };
    let run = |mut trainer: Trainer<'_>, at: u32| {
        let mut keep = Keep::at(at);
        (trainer.run(&mut keep).expect("trains"), keep.kept)
    };
    let resumed = |(state, buffers): (State, Vec<Vec<u8>>)| {
        let mut trainer = trainer();
        trainer.restore(state, &buffers.concat()).expect("fits");
        run(trainer, 0).0
    };
    let (whole, _) = run(trainer(), 0);
    // Between two looks, at one, after a plan and a reset, and at the end.
    for at in [13, 50, 30, 60] {
        let (other, kept) = run(trainer(), at);
        assert!(same(&whole, &other), "keeping after {at} changes the run");
        let kept = kept.expect("kept");
        assert!(same(&whole, &resumed(kept)), "differs from {at} on");
    }
    let (state, buffers) = run(trainer(), 37).1.expect("kept");
    for (i, _) in buffers.iter().enumerate() {
        let mut altered = buffers.clone();
        // The exponents' bits: no value stays what it was.
        altered[i]
            .iter_mut()
            .skip(3)
            .step_by(4)
            .for_each(|byte| *byte ^= 1);
        let other = resumed((state.clone(), altered));
        assert!(
            !same(&whole, &other),
            "buffer {i} of {} is idle",
            buffers.len()
        );
    }
    let short = &buffers.concat()[16..];
    let error = trainer().restore(state, short).unwrap_err().to_string();
    assert!(error.contains("the checkpoint has"), "{error}");
}
