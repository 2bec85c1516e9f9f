//! Depth is rendered through the colours: Gaussians as bright as they are deep, rendered as any
//! others.

use crate::camera::Camera;
use crate::error::Result;
use crate::gaussians::{Gaussians, SH_0};
use crate::gpu::Gpu;
use crate::render::{Model, Renderer, ViewUniform};

/// Renders the expected depth of every pixel along the camera's axis, `sum(w z) / sum(w)` over the
/// blending weights `w` and the means' depths `z`, in the unit of the camera; 0 where nothing is.
/// Row 0 on top.
///
/// # Errors
/// A view that the adapter cannot hold, or a GPU fault.
pub(crate) fn depth(
    gpu: &Gpu,
    renderer: &mut Renderer,
    gaussians: &Gaussians,
    camera: &Camera,
    near: f64,
) -> Result<Vec<f32>> {
    let axis = camera.forward();
    let eye = camera.center();
    let colors = gaussians.means.iter().flat_map(|mean| {
        let depth = axis.dot(mean.as_dvec3() - eye);
        [((depth - 0.5) / SH_0) as f32, 0.0, 0.0]
    });
    let as_deep = Gaussians {
        sh: colors.collect(),
        sh_degree: 0,
        ..gaussians.clone()
    };
    let model = Model::upload(gpu, &as_deep, as_deep.len())?;
    let view = ViewUniform::new(camera, near, [0.0; 3]);
    let rendered = renderer.render(&model, &view)?;
    let pixels = rendered.rgb.chunks_exact(3).zip(&rendered.alpha);
    let depth = pixels.map(|(rgb, alpha)| if *alpha > 0.0 { rgb[0] / alpha } else { 0.0 });
    Ok(depth.collect())
}
