//! The dense head (after Ranftl et al. 2021) finds depth and confidence of every pixel, and rays on
//! a coarser grid if they are asked for.

use rayon::prelude::*;

use super::layers::{LayerNorm, Linear, relu};
use super::maps::{Conv3, Map, Spread};
use super::model::Model;
use super::weights::Weights;
use super::{PATCH_PX, Rays, Watch};
use crate::error::Result;

const EPSILON: f32 = 1e-5;
/// Channels before the last 1x1 convolution.
const LAST: usize = 32;
/// Pixels of the fused map a patch's side.
const FUSED_PER_PATCH: usize = 8;

pub(super) struct Head {
    norm: LayerNorm,
    projects: Vec<Linear>,
    spread: [Spread; 2],
    shrink: Conv3,
    /// To the same number of channels.
    even: Vec<Conv3>,
    main: Pyramid,
    conv1: Conv3,
    conv2: Conv3,
    out: Linear,
    /// Read only if cameras come from rays.
    rays: Option<RayBranch>,
}

struct RayBranch {
    pyramid: Pyramid,
    convs: Vec<Conv3>,
    conv2: Conv3,
    norm: LayerNorm,
    out: Linear,
}

/// The head's outputs for one view.
pub(super) struct Dense {
    /// `[height][width]`.
    pub depth: Vec<f32>,
    /// `[height][width]`, above 1.
    pub confidence: Vec<f32>,
    pub rays: Option<Rays>,
}

impl Head {
    /// Reads the head; its ray branch, half of it, is read only `with_rays`.
    pub(crate) fn read(weights: &mut Weights, model: &Model, with_rays: bool) -> Result<Head> {
        let (c, f) = (2 * model.channels, model.features);
        let outs = model.out_channels;
        let name = |of: &str| format!("head.{of}");
        let scratch = |of: &str| format!("head.scratch.{of}");
        let project = |weights: &mut Weights, k: usize| {
            Linear::read_shaped(
                weights,
                &name(&format!("projects.{k}")),
                &[outs[k], c, 1, 1],
            )
        };
        let even = |weights: &mut Weights, k: usize| {
            let name = scratch(&format!("layer{}_rn", k + 1));
            Conv3::read_without_bias(weights, &name, outs[k], f)
        };
        Ok(Head {
            norm: LayerNorm::read(weights, &name("norm"), c, EPSILON)?,
            projects: (0..4).map(|k| project(weights, k)).collect::<Result<_>>()?,
            spread: [
                Spread::read(weights, &name("resize_layers.0"), outs[0], 4)?,
                Spread::read(weights, &name("resize_layers.1"), outs[1], 2)?,
            ],
            shrink: Conv3::read(weights, &name("resize_layers.3"), outs[3], outs[3])?
                .with_stride(2),
            even: (0..4).map(|k| even(weights, k)).collect::<Result<_>>()?,
            main: Pyramid::read(weights, "", f)?,
            conv1: Conv3::read(weights, &scratch("output_conv1"), f, f / 2)?,
            conv2: Conv3::read(weights, &scratch("output_conv2.0"), f / 2, LAST)?,
            out: Linear::read_shaped(weights, &scratch("output_conv2.2"), &[2, LAST, 1, 1])?,
            rays: if with_rays {
                Some(RayBranch::read(weights, f)?)
            } else {
                None
            },
        })
    }

    /// Finds the depth of one view from its four maps, `[patches][2 channels]` each, for a grid of
    /// patches.
    pub(crate) fn apply(
        &self,
        maps: [&[f32]; 4],
        (rows, columns): (usize, usize),
        watch: Watch<'_>,
    ) -> Dense {
        let (height, width) = (rows * PATCH_PX, columns * PATCH_PX);
        let aspect = width as f64 / height as f64;
        let levels: Vec<Map> = (0..4)
            .map(|k| {
                let mut map = Map {
                    height: rows,
                    width: columns,
                    channels: self.projects[k].n_out,
                    values: self.projects[k].apply(&self.norm.apply(maps[k])),
                };
                watch(&format!("head_project_{k}"), &map.values);
                map.add_places(aspect);
                let map = match k {
                    0 | 1 => self.spread[k].apply(&map),
                    2 => map,
                    _ => self.shrink.apply(&map),
                };
                watch(&format!("head_resized_{k}"), &map.values);
                let even = self.even[k].apply(&map);
                watch(&format!("head_rn_{}", k + 1), &even.values);
                even
            })
            .collect();
        let fused = self.main.fuse(&levels, "head_fused", watch);
        let first = self.conv1.apply(&fused);
        drop(fused);
        watch("head_out1", &first.values);
        let mut full = first.resized(height, width);
        full.add_places(aspect);
        let mut last = self.conv2.apply(&full);
        drop(full);
        relu(&mut last.values);
        let logits = last.pixelwise(&self.out).values;
        drop(last);
        watch("head_main_logits", &logits);
        let (depth, confidence): (Vec<f32>, Vec<f32>) = logits
            .as_chunks::<2>()
            .0
            .iter()
            .map(|[depth, confidence]| (depth.exp(), confidence.exp() + 1.0))
            .unzip();
        watch("depth", &depth);
        watch("depth_conf", &confidence);
        let rays = self.rays.as_ref();
        let rays = rays.map(|rays| rays.apply(&levels, aspect, watch));
        Dense {
            depth,
            confidence,
            rays,
        }
    }
}

impl RayBranch {
    fn read(weights: &mut Weights, f: usize) -> Result<RayBranch> {
        let scratch = |of: &str| format!("head.scratch.{of}");
        let conv = |weights: &mut Weights, k: usize| {
            let (n_in, n_out) = if k.is_multiple_of(2) {
                (f, f / 2)
            } else {
                (f / 2, f)
            };
            let name = scratch(&format!("output_conv1_aux.3.{k}"));
            Conv3::read(weights, &name, n_in, n_out)
        };
        // One norm is shared by four levels, and the file has it under the name that sorts first.
        let shared = scratch("output_conv2_aux.3.2");
        let norm = match weights.shape(&format!("{shared}.weight")) {
            Some(_) => shared,
            None => scratch("output_conv2_aux.0.2"),
        };
        let out = scratch("output_conv2_aux.3.5");
        Ok(RayBranch {
            pyramid: Pyramid::read(weights, "_aux", f)?,
            convs: (0..5).map(|k| conv(weights, k)).collect::<Result<_>>()?,
            conv2: Conv3::read(weights, &scratch("output_conv2_aux.3.0"), f / 2, LAST)?,
            norm: LayerNorm::read(weights, &norm, LAST, EPSILON)?,
            out: Linear::read_shaped(weights, &out, &[7, LAST, 1, 1])?,
        })
    }

    fn apply(&self, levels: &[Map], aspect: f64, watch: Watch<'_>) -> Rays {
        let mut map = self.pyramid.fuse(levels, "head_aux_fused", watch);
        for conv in &self.convs {
            map = conv.apply(&map);
        }
        watch("head_aux_out1", &map.values);
        map.add_places(aspect);
        let mut last = self.conv2.apply(&map);
        last.values.par_chunks_exact_mut(LAST).for_each(|pixel| {
            self.norm.row(pixel);
            relu(pixel);
        });
        let logits = last.pixelwise(&self.out).values;
        watch("head_aux_logits", &logits);
        let mut rays = Rays {
            height: map.height,
            width: map.width,
            rays: Vec::with_capacity(map.height * map.width),
            confidence: Vec::with_capacity(map.height * map.width),
        };
        for [ray @ .., confidence] in logits.as_chunks::<7>().0 {
            rays.rays.push(*ray);
            rays.confidence.push(confidence.exp() + 1.0);
        }
        watch("ray", rays.rays.as_flattened());
        watch("ray_conf", &rays.confidence);
        rays
    }
}

/// Fuses maps from the coarsest to the finest.
struct Pyramid {
    /// From the finest on, as they are named.
    stages: Vec<Fusion>,
}

struct Fusion {
    /// Takes in the finer map; the coarsest stage has none.
    side: Option<Residual>,
    top: Residual,
    out: Linear,
}

struct Residual {
    conv1: Conv3,
    conv2: Conv3,
}

impl Pyramid {
    fn read(weights: &mut Weights, suffix: &str, features: usize) -> Result<Pyramid> {
        let stage = |k: usize| {
            let name = format!("head.scratch.refinenet{k}{suffix}");
            let mut residual = |of: &str| -> Result<Residual> {
                let mut conv = |conv: &str| {
                    Conv3::read(weights, &format!("{name}.{of}.{conv}"), features, features)
                };
                Ok(Residual {
                    conv1: conv("conv1")?,
                    conv2: conv("conv2")?,
                })
            };
            let side = if k < 4 {
                Some(residual("resConfUnit1")?)
            } else {
                None
            };
            let top = residual("resConfUnit2")?;
            let shape = [features, features, 1, 1];
            let out = Linear::read_shaped(weights, &format!("{name}.out_conv"), &shape)?;
            Ok(Fusion { side, top, out })
        };
        Ok(Pyramid {
            stages: (1..=4).map(stage).collect::<Result<_>>()?,
        })
    }

    /// Fuses the levels to one map of [`FUSED_PER_PATCH`] pixels a patch's side.
    fn fuse(&self, levels: &[Map], name: &str, watch: Watch<'_>) -> Map {
        let (last, finer) = (&levels[3], &levels[..3]);
        let mut map = self.stages[3].apply(last, None, (finer[2].height, finer[2].width));
        watch(&format!("{name}_4"), &map.values);
        for k in (0..3).rev() {
            let size = match k {
                0 => {
                    let patches = (levels[2].height, levels[2].width);
                    (FUSED_PER_PATCH * patches.0, FUSED_PER_PATCH * patches.1)
                }
                _ => (finer[k - 1].height, finer[k - 1].width),
            };
            map = self.stages[k].apply(&map, Some(&finer[k]), size);
            watch(&format!("{name}_{}", k + 1), &map.values);
        }
        map
    }
}

impl Fusion {
    fn apply(&self, top: &Map, side: Option<&Map>, (height, width): (usize, usize)) -> Map {
        let sum = match (&self.side, side) {
            (Some(residual), Some(side)) => {
                let mut sum = residual.apply(side);
                sum.add(top);
                self.top.apply(&sum)
            }
            _ => self.top.apply(top),
        };
        // Interpolation and a product over channels commute; the product is cheaper first.
        sum.pixelwise(&self.out).resized(height, width)
    }
}

impl Residual {
    /// Computes `x + conv2(relu(conv1(relu(x))))`.
    fn apply(&self, x: &Map) -> Map {
        let mut out = self.conv2.apply_rectified(&self.conv1.apply_rectified(x));
        out.add(x);
        out
    }
}
