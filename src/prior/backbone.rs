//! The backbone is a `DINOv2` transformer over the patches of all views, in whose later half every
//! other block attends across views.

use rayon::prelude::*;

use super::block::{Block, BlockSpec};
use super::layers::{LayerNorm, Linear};
use super::model::Model;
use super::reference_view;
use super::rope::Rope;
use super::weights::Weights;
use super::{Images, PATCH_PX, Watch};
use crate::error::Result;

/// Side of the grid of stored position embeddings.
const GRID: usize = 37;
const BLOCK_EPSILON: f32 = 1e-6;
const FINAL_EPSILON: f32 = 1e-5;

pub(super) struct Backbone {
    model: Model,
    patch_embed: Linear,
    cls_token: Vec<f32>,
    /// `[1 + 37 * 37][channels]`, the class token's first.
    pos_embed: Vec<f32>,
    /// Tokens of the reference view and of all others, `[2][channels]`.
    camera_token: Vec<f32>,
    blocks: Vec<Block>,
    norm: LayerNorm,
}

/// The features that the backbone gives: for each output block, in the views' given order.
pub(super) struct Features {
    /// `[views][patches][2 channels]`, four times.
    pub maps: Vec<Vec<f32>>,
    /// Camera tokens of the last output block, `[views][2 channels]`.
    pub camera: Vec<f32>,
    /// The view in whose frame the cameras are.
    pub reference: usize,
}

impl Backbone {
    pub(crate) fn read(weights: &mut Weights, model: &Model) -> Result<Backbone> {
        let c = model.channels;
        let name = |of: &str| format!("backbone.pretrained.{of}");
        let block = |weights: &mut Weights, i: usize| {
            let spec = BlockSpec {
                channels: c,
                n_heads: model.n_heads,
                norm_epsilon: BLOCK_EPSILON,
                qk_norm: i >= model.alt_start,
            };
            Block::read(weights, &name(&format!("blocks.{i}")), spec)
        };
        let patch = [c, 3, PATCH_PX, PATCH_PX];
        Ok(Backbone {
            patch_embed: Linear::read_shaped(weights, &name("patch_embed.proj"), &patch)?,
            cls_token: weights.tensor(&name("cls_token"), &[1, 1, c])?,
            pos_embed: weights.tensor(&name("pos_embed"), &[1, 1 + GRID * GRID, c])?,
            camera_token: weights.tensor(&name("camera_token"), &[1, 2, c])?,
            blocks: (0..model.n_blocks)
                .map(|i| block(weights, i))
                .collect::<Result<_>>()?,
            norm: LayerNorm::read(weights, &name("norm"), c, FINAL_EPSILON)?,
            model: model.clone(),
        })
    }

    /// Computes the features of all views. `cameras`, `[views][channels]`, stand for known cameras;
    /// without them a reference view is chosen.
    pub(crate) fn apply(
        &self,
        images: &Images,
        cameras: Option<&[f32]>,
        watch: Watch<'_>,
    ) -> Features {
        let c = self.model.channels;
        let (rows, columns) = images.patches();
        let n_patches = rows * columns;
        let n_tokens = 1 + n_patches;
        let n_views = images.n_views;
        let mut x = self.tokens(images, watch);
        // The view that stands at each place inside.
        let mut order: Vec<usize> = (0..n_views).collect();
        let head_dim = c / self.model.n_heads;
        let by_place = Rope::of_grid(rows, columns, head_dim);
        let without_place = Rope::without_place(n_patches, head_dim);
        let mut features = Features {
            maps: Vec::new(),
            camera: Vec::new(),
            reference: 0,
        };
        let mut local = Vec::new();
        for (i, block) in self.blocks.iter().enumerate() {
            if i + 1 == self.model.alt_start && n_views >= 3 && cameras.is_none() {
                let class_tokens: Vec<&[f32]> = x
                    .chunks_exact(n_tokens * c)
                    .map(|view| &view[..c])
                    .collect();
                features.reference = reference_view::choose(&class_tokens);
                let first = features.reference;
                order.sort_by_key(|view| *view != first);
                x = order
                    .iter()
                    .flat_map(|v| &x[v * n_tokens * c..][..n_tokens * c])
                    .copied()
                    .collect();
            }
            if i == self.model.alt_start {
                self.put_camera_tokens(&mut x, n_tokens, cameras);
                watch("tokens_at_alt_start", &x);
            }
            let is_late = i >= self.model.alt_start;
            let is_global = is_late && i % 2 == 1;
            if is_global {
                block.apply(&mut x, n_views * n_tokens, Some(&without_place));
            } else {
                block.apply(&mut x, n_tokens, is_late.then_some(&by_place));
                local.clone_from(&x);
            }
            watch(&format!("block_{i}"), &x);
            if let Some(k) = self.model.outputs.iter().position(|output| *output == i) {
                let mut map = vec![0.0; n_views * n_patches * 2 * c];
                let mut camera = vec![0.0; n_views * 2 * c];
                for (place, view) in order.iter().enumerate() {
                    let tokens = place * n_tokens * c..(place + 1) * n_tokens * c;
                    let (local, x) = (&local[tokens.clone()], &x[tokens]);
                    let (first, second) = camera[view * 2 * c..][..2 * c].split_at_mut(c);
                    first.copy_from_slice(&local[..c]);
                    second.copy_from_slice(&x[..c]);
                    let patches = map[view * n_patches * 2 * c..][..n_patches * 2 * c]
                        .par_chunks_exact_mut(2 * c);
                    patches.enumerate().for_each(|(patch, out)| {
                        let (first, second) = out.split_at_mut(c);
                        let token = (1 + patch) * c..(2 + patch) * c;
                        first.copy_from_slice(&local[token.clone()]);
                        second.copy_from_slice(&x[token]);
                        self.norm.row(second);
                    });
                }
                watch(&format!("feat_{k}"), &map);
                watch(&format!("cam_{k}"), &camera);
                features.maps.push(map);
                features.camera = camera;
            }
        }
        features
    }

    /// Overwrites the class tokens by camera tokens.
    fn put_camera_tokens(&self, x: &mut [f32], n_tokens: usize, cameras: Option<&[f32]>) {
        let c = self.model.channels;
        for (place, view) in x.chunks_exact_mut(n_tokens * c).enumerate() {
            let token = match cameras {
                Some(cameras) => &cameras[place * c..],
                None => &self.camera_token[place.min(1) * c..],
            };
            view[..c].copy_from_slice(&token[..c]);
        }
    }

    /// Makes `[views][1 + patches][channels]`: the class token, then the patches row by row, each
    /// with its position embedding.
    fn tokens(&self, images: &Images, watch: Watch<'_>) -> Vec<f32> {
        let c = self.model.channels;
        let (rows, columns) = images.patches();
        let positions = self.positions(rows, columns);
        watch("pos_embed", &positions);
        let embedded = self.patch_embed.apply(&images.unfolded());
        let mut x = Vec::with_capacity(images.n_views * positions.len());
        for view in embedded.chunks_exact(rows * columns * c) {
            let tokens = self.cls_token.iter().chain(view);
            x.extend(
                tokens
                    .zip(&positions)
                    .map(|(token, position)| token + position),
            );
        }
        watch("tokens", &x);
        x
    }

    /// Returns the position embeddings for a grid of patches: the stored grid, interpolated
    /// bicubically.
    fn positions(&self, rows: usize, columns: usize) -> Vec<f32> {
        if (rows, columns) == (GRID, GRID) {
            return self.pos_embed.clone();
        }
        let c = self.model.channels;
        let (class, grid) = self.pos_embed.split_at(c);
        let (by_row, by_column) = (taps(rows), taps(columns));
        // Rows first: `[rows][GRID][channels]`.
        let mut between = vec![0.0_f64; rows * GRID * c];
        for (row, taps) in between.chunks_exact_mut(GRID * c).zip(&by_row) {
            for (source, weight) in taps {
                let source = &grid[source * GRID * c..][..GRID * c];
                row.iter_mut()
                    .zip(source)
                    .for_each(|(sum, x)| *sum += weight * f64::from(*x));
            }
        }
        let mut positions = class.to_vec();
        for row in between.chunks_exact(GRID * c) {
            for taps in &by_column {
                let value = |channel: usize| -> f64 {
                    taps.iter()
                        .map(|(source, weight)| weight * row[source * c + channel])
                        .sum()
                };
                positions.extend((0..c).map(|channel| value(channel) as f32));
            }
        }
        positions
    }
}

/// Returns for each of `n` places the four stored ones around it and their weights. The scale is
/// that of n + 0.1 places, as the weights were trained with.
fn taps(n: usize) -> Vec<[(usize, f64); 4]> {
    const A: f64 = -0.75;
    let near = |d: f64| ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0;
    let far = |d: f64| ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A;
    let place = |i: usize| {
        let source = (i as f64 + 0.5) * GRID as f64 / (n as f64 + 0.1) - 0.5;
        let t = source - source.floor();
        let weights = [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)];
        std::array::from_fn(|tap| {
            let at = source.floor() + tap as f64 - 1.0;
            (at.clamp(0.0, (GRID - 1) as f64) as usize, weights[tap])
        })
    };
    (0..n).map(place).collect()
}
