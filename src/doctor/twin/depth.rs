//! Depths and normals by brute force, pixel by pixel, and their derivative.

use rayon::prelude::*;

use super::linalg::{Vec3, apply, cross, dot, normalize, normalize_backward, transpose};
use super::model::{SplatGradient, TwinCamera, TwinGaussians};
use super::project::{RawGradient, project_backward, rotation_matrix, rotation_matrix_backward};
use super::random::{Random, f32_exact};
use super::raster::{BAND, Blend, TwinRender, active, alpha_backward, row_of, walk};

/// A number a kind for each pixel: what is rendered, or the weights of these in a linear loss.
#[derive(Clone, Copy, Debug, Default)]
pub struct TwinDepth {
    /// Sum of `w z` over the blended Gaussians' weights and camera depths.
    pub sum: f64,
    /// Sum of `w n` over their normals, in the camera's axes.
    pub normal: Vec3,
    /// Depth of the Gaussian that takes the transmittance to a half or less; 0: none does.
    pub median: f64,
    /// Depth of the first Gaussian of the largest weight; 0: there is none.
    pub mode: f64,
    /// 1 - final transmittance.
    pub alpha: f64,
}

/// Depths and normals of a view, row-major from the top.
#[derive(Clone, Debug)]
pub struct TwinDepths {
    /// One entry a pixel.
    pub pixels: Vec<TwinDepth>,
    /// Pixels at which single precision may decide otherwise: those of the render, and where another
    /// Gaussian may be the median or the mode, or a normal may point to the other side.
    pub fragile: Vec<bool>,
}

/// The gradients of a linear loss of depths and normals.
#[derive(Clone, Debug)]
pub struct TwinDepthGradients {
    /// To the splats.
    pub splats: Vec<SplatGradient>,
    /// To the Gaussians' normals, in the camera's axes, and depths.
    pub depths: Vec<[f64; 4]>,
    /// To the raw parameters; that to SH is 0.
    pub raw: Vec<RawGradient>,
}

/// A Gaussian's flattest axis, the first of equal ones, on the camera's side.
struct Normal {
    axis: usize,
    side: f64,
    /// In the camera's axes.
    normal: Vec3,
    /// Cosine of the angle to the direction to the camera.
    cosine: f64,
}

fn normal(gaussians: &TwinGaussians, i: usize, camera: &TwinCamera) -> Normal {
    let scales = gaussians.scale_log[i];
    let axis = (1..3).fold(
        0,
        |least, k| if scales[k] < scales[least] { k } else { least },
    );
    let (q, _) = normalize(&gaussians.rotation_wxyz[i]);
    let r = rotation_matrix(q);
    let n = apply(&camera.rotation(), &[0, 1, 2].map(|row| r[row][axis]));
    let (direction, _) = normalize(&camera.to_camera(&gaussians.means[i]));
    let along = dot(&n, &direction);
    let side = if along > 0.0 { -1.0 } else { 1.0 };
    Normal {
        axis,
        side,
        normal: n.map(|x| side * x),
        cosine: along.abs(),
    }
}

/// Returns each Gaussian's normal in the camera's axes with its camera depth, and the cosine of the
/// angle between the normal and the direction to the camera.
pub fn splat_depths(gaussians: &TwinGaussians, camera: &TwinCamera) -> Vec<([f64; 4], f64)> {
    let of = |i: usize| {
        let Normal { normal, cosine, .. } = normal(gaussians, i, camera);
        let [x, y, z] = normal;
        ([x, y, z, camera.to_camera(&gaussians.means[i])[2]], cosine)
    };
    (0..gaussians.n()).map(of).collect()
}

/// Places in `blends` of the Gaussian that takes the transmittance to a half, and of the largest weight.
fn places(blends: &[Blend]) -> (Option<usize>, Option<usize>) {
    let weight = |b: &Blend| b.alpha * b.transmittance;
    let median = blends
        .iter()
        .position(|b| b.transmittance * (1.0 - b.alpha) <= 0.5);
    let mode = (0..blends.len()).reduce(|best, k| {
        if weight(&blends[k]) > weight(&blends[best]) {
            k
        } else {
            best
        }
    });
    (median, mode)
}

/// Renders depths and normals of the view of which `render` is the image; decisions within relative
/// `tolerance` are fragile.
pub fn render_depths(
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    render: &TwinRender,
    tolerance: f64,
) -> TwinDepths {
    let normals: Vec<Normal> = (0..gaussians.n())
        .map(|i| normal(gaussians, i, camera))
        .collect();
    let active = active(&render.projected, tolerance);
    let rows = (0..camera.height).into_par_iter().map(|y| {
        let row = row_of(&active, y);
        let mut blends = Vec::new();
        let pixel = |x: usize| {
            let (transmittance, mut fragile) = walk(&row, (x, y), tolerance, &mut blends);
            let mut out = TwinDepth {
                alpha: 1.0 - transmittance,
                ..TwinDepth::default()
            };
            let (median, mode) = places(&blends);
            for (k, blend) in blends.iter().enumerate() {
                let weight = blend.alpha * blend.transmittance;
                let next = blend.transmittance - weight;
                out.sum += weight * blend.splat.depth;
                for axis in 0..3 {
                    out.normal[axis] += weight * normals[blend.id].normal[axis];
                }
                fragile |= (next - 0.5).abs() <= tolerance;
                fragile |= normals[blend.id].cosine <= tolerance;
                if let Some(mode) = mode {
                    let most = blends[mode].alpha * blends[mode].transmittance;
                    fragile |= k != mode && most - weight <= tolerance * most;
                }
            }
            out.median = median.map_or(0.0, |k| blends[k].splat.depth);
            out.mode = mode.map_or(0.0, |k| blends[k].splat.depth);
            (out, fragile)
        };
        (0..camera.width).map(pixel).collect::<Vec<_>>()
    });
    let pixels: Vec<(TwinDepth, bool)> = rows.collect::<Vec<_>>().concat();
    TwinDepths {
        fragile: pixels
            .iter()
            .zip(&render.fragile)
            .map(|(pixel, of_image)| pixel.1 || *of_image)
            .collect(),
        pixels: pixels.into_iter().map(|pixel| pixel.0).collect(),
    }
}

/// Draws weights in [-1, 1) of a linear loss, 0 at fragile pixels.
pub fn depth_weights(depths: &TwinDepths, seed: u64) -> Vec<TwinDepth> {
    let mut random = Random::new(seed);
    let draw = |fragile: &bool| {
        let mut one = || f32_exact(random.uniform(-1.0, 1.0));
        let weights = TwinDepth {
            sum: one(),
            normal: [one(), one(), one()],
            median: one(),
            mode: one(),
            alpha: one(),
        };
        if *fragile {
            TwinDepth::default()
        } else {
            weights
        }
    };
    depths.fragile.iter().map(draw).collect()
}

/// Returns the linear loss of what is rendered with the weights `d`.
pub fn linear_loss(depths: &TwinDepths, d: &[TwinDepth]) -> f64 {
    let product = |(p, d): (&TwinDepth, &TwinDepth)| {
        p.sum * d.sum
            + dot(&p.normal, &d.normal)
            + p.median * d.median
            + p.mode * d.mode
            + p.alpha * d.alpha
    };
    depths.pixels.iter().zip(d).map(product).sum()
}

/// Returns the gradients of [`linear_loss`], with every decision held.
pub fn depths_backward(
    gaussians: &TwinGaussians,
    camera: &TwinCamera,
    render: &TwinRender,
    d: &[TwinDepth],
) -> TwinDepthGradients {
    let n = gaussians.n();
    let normals: Vec<Normal> = (0..n).map(|i| normal(gaussians, i, camera)).collect();
    let active = active(&render.projected, 0.0);
    type Sums = (Vec<SplatGradient>, Vec<[f64; 4]>);
    let none = || -> Sums { (vec![[0.0; 9]; n], vec![[0.0; 4]; n]) };
    let bands: Vec<Sums> = (0..camera.height.div_ceil(BAND))
        .into_par_iter()
        .map(|band| {
            let (mut splats, mut depths) = none();
            let mut blends = Vec::new();
            for y in band * BAND..camera.height.min((band + 1) * BAND) {
                let row = row_of(&active, y);
                for x in 0..camera.width {
                    let d = d[y * camera.width + x];
                    let (transmittance, _) = walk(&row, (x, y), 0.0, &mut blends);
                    let mut behind = -transmittance * d.alpha;
                    for blend in blends.iter().rev() {
                        let weight = blend.alpha * blend.transmittance;
                        let of_normal = normals[blend.id].normal;
                        let own = d.sum * blend.splat.depth + dot(&d.normal, &of_normal);
                        let d_alpha = blend.transmittance * own - behind / (1.0 - blend.alpha);
                        behind += weight * own;
                        alpha_backward(blend, d_alpha, &mut splats[blend.id]);
                        let sum = &mut depths[blend.id];
                        for (sum, d) in sum.iter_mut().zip(d.normal) {
                            *sum += weight * d;
                        }
                        sum[3] += weight * d.sum;
                    }
                    let (median, mode) = places(&blends);
                    for (place, d) in [(median, d.median), (mode, d.mode)] {
                        if let Some(k) = place {
                            depths[blends[k].id][3] += d;
                        }
                    }
                }
            }
            (splats, depths)
        })
        .collect();
    let (mut splats, mut depths) = none();
    for (of_splats, of_depths) in &bands {
        let add = |sum: &mut [f64], part: &[f64]| {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        };
        add(splats.as_flattened_mut(), of_splats.as_flattened());
        add(depths.as_flattened_mut(), of_depths.as_flattened());
    }
    let raw = (0..n).map(|i| {
        let mut raw = project_backward(gaussians, i, camera, &splats[i]);
        if render.projected[i].valid {
            add_depth(&mut raw, (gaussians, i), camera, &normals[i], &depths[i]);
        }
        raw
    });
    TwinDepthGradients {
        raw: raw.collect(),
        splats,
        depths,
    }
}

/// Adds what the gradient to a Gaussian's normal and depth is to its raw parameters and to the camera.
fn add_depth(
    raw: &mut RawGradient,
    (gaussians, i): (&TwinGaussians, usize),
    camera: &TwinCamera,
    normal: &Normal,
    &[x, y, z, d_depth]: &[f64; 4],
) {
    let d_normal = [x, y, z];
    let to_world = transpose(&camera.rotation());
    let d_mean = apply(&to_world, &[0.0, 0.0, d_depth]);
    let d_axis = apply(&to_world, &d_normal).map(|d| normal.side * d);
    let mut d_rotation = [[0.0; 3]; 3];
    for row in 0..3 {
        d_rotation[row][normal.axis] = d_axis[row];
    }
    let (q, norm) = normalize(&gaussians.rotation_wxyz[i]);
    let d_q = normalize_backward(&q, norm, &rotation_matrix_backward(q, &d_rotation));
    let p = camera.to_camera(&gaussians.means[i]);
    let (of_mean, of_normal) = (
        cross(&p, &[0.0, 0.0, d_depth]),
        cross(&normal.normal, &d_normal),
    );
    for axis in 0..3 {
        raw.mean[axis] += d_mean[axis];
        raw.pose[axis] += of_mean[axis] + of_normal[axis];
    }
    raw.pose[5] += d_depth;
    raw.rotation_wxyz
        .iter_mut()
        .zip(d_q)
        .for_each(|(r, d)| *r += d);
}
