//! The gradient with respect to the camera's pose.

use super::finding::Findings;
use super::rig::{Context, POISON, Rig};
use super::stage;
use crate::error::Result;
use crate::gpu::Commands;
use crate::render::PoseGradient;

/// Holds turn and shift after a backward pass to those of the reference.
///
/// # Errors
/// A GPU fault.
pub fn examine(
    ctx: &Context,
    rig: &Rig,
    twin: &[f64; 6],
    bound: f64,
    out: &mut Findings,
) -> Result<()> {
    let pose = PoseGradient::new(&ctx.gpu, &ctx.pose, &rig.workspace, &rig.model)?;
    for buffer in pose.outputs() {
        buffer.write(&ctx.gpu, &vec![POISON; buffer.bytes() as usize / 4]);
    }
    let mut commands = Commands::new(&ctx.gpu);
    rig.pass(ctx).pose_backward(&mut commands, &ctx.pose, &pose);
    commands.submit();
    let ours = pose.read(&ctx.gpu)?;
    for (what, part) in [("turn", 0..3), ("shift", 3..6)] {
        let at = (stage::POSE_BACKWARD, what);
        out.close(at, &ours[part.clone()], &twin[part], bound);
    }
    Ok(())
}
