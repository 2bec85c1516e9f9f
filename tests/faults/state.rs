//! The state of a training in progress: whole, and every part of it needed.

use gspotential::error::Result;
use gspotential::pipeline::prepare;
use gspotential::run::Seconds;
use gspotential::train::LossSample;
use gspotential::train::{Observer, State, Trained, Trainer};

use super::job;
use crate::gpu::rig::context;

/// Keeps the state after some iterations.
struct Keep {
    at: u32,
    kept: Option<(State, Vec<Vec<u8>>)>,
}

impl Observer for Keep {
    fn look(&mut self, _: &LossSample, _: usize) {}

    fn keeps(&self, done: u32) -> bool {
        done == self.at
    }

    fn keep(
        &mut self,
        state: &State,
        buffers: &mut dyn Iterator<Item = Result<Vec<u8>>>,
    ) -> Result<()> {
        self.kept = Some((state.clone(), buffers.collect::<Result<_>>()?));
        Ok(())
    }
}

fn same(one: &Trained, other: &Trained) -> bool {
    one.gaussians == other.gaussians && one.samples == other.samples && one.plans == other.plans
}

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
        let mut keep = Keep { at, kept: None };
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
