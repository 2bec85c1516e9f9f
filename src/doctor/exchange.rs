//! What two sets of Gaussians hand over: renders as target images, and the first step that did not fit.

use super::finding::Findings;
use super::rig::{Context, Rig};
use super::{loss, stage};
use crate::doctor::twin::random::Random;
use crate::error::Result;
use crate::gpu::constants::{N_TOTALS, TOTAL_OVERFLOW};
use crate::gpu::{Buffer, Commands};
use crate::train::partner::PSEUDO_SLOT;
use crate::train::partner::exchange::Exchange;

/// Half a level, and what f32 may do to a value in the middle between two.
const ROUNDING: f64 = 0.5 + 1e-3;

/// Two sets' renders, with what hands them over.
pub struct Pair {
    rigs: [Rig; 2],
    exchange: Exchange,
}

impl Pair {
    /// Makes the buffers of two renders of this size.
    ///
    /// # Errors
    /// A case that the adapter cannot hold.
    pub fn new(ctx: &Context, size: (usize, usize)) -> Result<Pair> {
        let rigs = [loss::rig(ctx, size)?, loss::rig(ctx, size)?];
        // Writes the views' uniforms.
        for rig in &rigs {
            let _ = rig.pass_in(ctx, PSEUDO_SLOT);
        }
        let spaces = rigs.each_ref().map(|rig| &rig.workspace);
        let exchange = Exchange::new(&ctx.gpu, &ctx.exchange, spaces);
        Ok(Pair { rigs, exchange })
    }

    /// Records that both hand their renders over.
    pub fn hand_over(&self, ctx: &Context, commands: &mut Commands<'_>) {
        let view = &self.rigs[0].view;
        self.exchange.hand_over(commands, &ctx.exchange, view);
    }
}

/// Hands random images over, some beyond `[0, 1]`, and steps that did not fit; holds what arrives to the reference.
///
/// # Errors
/// A GPU fault, or a case that the adapter cannot hold.
pub fn examine(ctx: &Context, size: (usize, usize)) -> Result<Findings> {
    let (width, height) = size;
    let mut out = Findings::of(format!("{width}x{height}"));
    let pair = Pair::new(ctx, size)?;
    let mut random = Random::new(23);
    let images = [(); 2].map(|()| -> Vec<f64> {
        let values = (0..3 * width * height).map(|_| random.uniform(-0.3, 1.3) as f32);
        values.map(f64::from).collect()
    });
    let transmittance = vec![0.5; width * height];
    for (rig, image) in pair.rigs.iter().zip(&images) {
        rig.write_image(ctx, "rendered", image, &transmittance, f32::NAN);
        rig.poison_goal(ctx, PSEUDO_SLOT);
    }
    let mut commands = Commands::new(&ctx.gpu);
    pair.hand_over(ctx, &mut commands);
    commands.submit();
    for (from, to) in [(0, 1), (1, 0)] {
        let texels = pair.rigs[to].read_goal(ctx, PSEUDO_SLOT)?;
        let levels = |texel: &u32| texel.to_le_bytes().map(f64::from);
        let ours: Vec<f64> = texels
            .iter()
            .flat_map(|t| levels(t)[..3].to_vec())
            .collect();
        let expected = images[from].iter().map(|c| 255.0 * c.clamp(0.0, 1.0));
        let expected: Vec<f64> = expected.collect();
        let no_mask = vec![false; width * height];
        out.image(
            (stage::EXCHANGE, "levels"),
            &ours,
            &expected,
            &no_mask,
            ROUNDING,
        );
        let n_transparent = texels.iter().filter(|texel| **texel >> 24 != 255).count();
        out.none((stage::EXCHANGE, "weights"), n_transparent);
    }
    let totals = pair.rigs.each_ref().map(|rig| rig.buffer("totals"));
    let read = |buffer: &Buffer| -> Result<Vec<u32>> { buffer.read(&ctx.gpu, N_TOTALS as usize) };
    // 0: the step did fit.
    for (steps, first) in [
        ([0, 0], 0),
        ([0, 7], 7),
        ([9, 0], 9),
        ([4, 6], 4),
        ([6, 4], 4),
    ] {
        let mut expected = Vec::new();
        for (buffer, step) in totals.iter().zip(steps) {
            let mut counts: Vec<u32> = (100..100 + N_TOTALS).collect();
            counts[TOTAL_OVERFLOW as usize] = step;
            buffer.write(&ctx.gpu, &counts);
            counts[TOTAL_OVERFLOW as usize] = first;
            expected.push(counts);
        }
        let mut commands = Commands::new(&ctx.gpu);
        pair.exchange.share_overflow(&mut commands, &ctx.exchange);
        commands.submit();
        let after = [read(totals[0])?, read(totals[1])?];
        out.equal((stage::EXCHANGE, "step without room"), &after, &expected);
    }
    Ok(out)
}
