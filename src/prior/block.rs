//! A transformer block has attention and a perceptron, each on a normalised copy and added back.

use rayon::prelude::*;

use super::layers::{LayerNorm, Linear};
use super::math::{Strided, exponentials, gelu, multiply};
use super::rope::Rope;
use super::weights::Weights;
use crate::error::Result;

/// Queries whose scores one thread holds at once; a constant, as `layers::BAND_ROWS`.
pub(super) const BAND_QUERIES: usize = 128;

/// A block of `DINOv2`'s kind (Oquab et al. 2023).
#[derive(Clone, Debug)]
pub(super) struct Block {
    n_heads: usize,
    norm1: LayerNorm,
    qkv: Linear,
    /// Norms of queries and keys, over the channels of a head.
    qk_norms: Option<(LayerNorm, LayerNorm)>,
    proj: Linear,
    ls1: Vec<f32>,
    norm2: LayerNorm,
    mlp: Mlp,
    ls2: Vec<f32>,
}

#[derive(Clone, Debug)]
enum Mlp {
    Gelu {
        fc1: Linear,
        fc2: Linear,
    },
    /// `w3 (silu(a) b)`, a and b the halves of `w12 x` (Shazeer 2020).
    SwiGlu {
        w12: Linear,
        w3: Linear,
    },
}

/// The sizes and options that a block is read with.
#[derive(Clone, Copy)]
pub(super) struct BlockSpec {
    pub channels: usize,
    pub n_heads: usize,
    pub norm_epsilon: f32,
    pub qk_norm: bool,
}

/// Epsilon of the norms of queries and keys.
const QK_EPSILON: f32 = 1e-5;

impl Block {
    pub(crate) fn read(weights: &mut Weights, name: &str, spec: BlockSpec) -> Result<Block> {
        let c = spec.channels;
        let d = c / spec.n_heads;
        let gated = weights.shape(&format!("{name}.mlp.w12.weight"));
        let mlp = if let Some(shape) = gated {
            let hidden = shape.first().map_or(0, |n| n / 2);
            Mlp::SwiGlu {
                w12: Linear::read(weights, &format!("{name}.mlp.w12"), c, 2 * hidden)?,
                w3: Linear::read(weights, &format!("{name}.mlp.w3"), hidden, c)?,
            }
        } else {
            Mlp::Gelu {
                fc1: Linear::read(weights, &format!("{name}.mlp.fc1"), c, 4 * c)?,
                fc2: Linear::read(weights, &format!("{name}.mlp.fc2"), 4 * c, c)?,
            }
        };
        let mut norm =
            |of: &str, n, epsilon| LayerNorm::read(weights, &format!("{name}.{of}"), n, epsilon);
        let norm1 = norm("norm1", c, spec.norm_epsilon)?;
        let norm2 = norm("norm2", c, spec.norm_epsilon)?;
        let qk_norms = match spec.qk_norm {
            true => Some((
                norm("attn.q_norm", d, QK_EPSILON)?,
                norm("attn.k_norm", d, QK_EPSILON)?,
            )),
            false => None,
        };
        Ok(Block {
            n_heads: spec.n_heads,
            norm1,
            qkv: Linear::read(weights, &format!("{name}.attn.qkv"), c, 3 * c)?,
            qk_norms,
            proj: Linear::read(weights, &format!("{name}.attn.proj"), c, c)?,
            ls1: weights.tensor(&format!("{name}.ls1.gamma"), &[c])?,
            norm2,
            mlp,
            ls2: weights.tensor(&format!("{name}.ls2.gamma"), &[c])?,
        })
    }

    /// Runs the block on `x`, `[tokens][channels]`, in place. Tokens attend to those of their own
    /// group of `group` consecutive ones; `rope` turns queries and keys by each token's place.
    pub(crate) fn apply(&self, x: &mut [f32], group: usize, rope: Option<&Rope>) {
        let mut qkv = self.qkv.apply(&self.norm1.apply(x));
        self.prepare(&mut qkv, rope);
        let attended = attention(&qkv, self.proj.n_in, self.n_heads, group);
        drop(qkv);
        self.proj.add_scaled_to(x, &attended, &self.ls1);
        drop(attended);
        let normed = self.norm2.apply(x);
        match &self.mlp {
            Mlp::Gelu { fc1, fc2 } => {
                let mut hidden = fc1.apply(&normed);
                drop(normed);
                hidden.par_chunks_mut(1 << 14).for_each(gelu);
                fc2.add_scaled_to(x, &hidden, &self.ls2);
            }
            Mlp::SwiGlu { w12, w3 } => {
                let both = w12.apply(&normed);
                let gated: Vec<f32> = both
                    .par_chunks_exact(w12.n_out)
                    .flat_map_iter(|row| {
                        let (a, b) = row.split_at(row.len() / 2);
                        a.iter().zip(b).map(|(a, b)| a / (1.0 + (-a).exp()) * b)
                    })
                    .collect();
                w3.add_scaled_to(x, &gated, &self.ls2);
            }
        }
    }

    /// Norms and turns the queries and keys of `[tokens][3 channels]`.
    fn prepare(&self, qkv: &mut [f32], rope: Option<&Rope>) {
        if self.qk_norms.is_none() && rope.is_none() {
            return;
        }
        let c = self.proj.n_in;
        let d = c / self.n_heads;
        qkv.par_chunks_exact_mut(3 * c)
            .enumerate()
            .for_each(|(token, row)| {
                let (queries, rest) = row.split_at_mut(c);
                let keys = &mut rest[..c];
                for (heads, is_query) in [(queries, true), (keys, false)] {
                    for head in heads.chunks_exact_mut(d) {
                        if let Some((q_norm, k_norm)) = &self.qk_norms {
                            if is_query { q_norm } else { k_norm }.row(head);
                        }
                        if let Some(rope) = rope {
                            rope.turn(head, token);
                        }
                    }
                }
            });
    }
}

/// Computes `softmax(q k^T / sqrt(d)) v` for each head, within groups of tokens: `[tokens][3
/// channels]` to `[tokens][channels]`. The scores of [`BAND_QUERIES`] queries of one head are held
/// at a time.
fn attention(qkv: &[f32], channels: usize, n_heads: usize, group: usize) -> Vec<f32> {
    let d = channels / n_heads;
    let row = 3 * channels;
    let n_tokens = qkv.len() / row;
    let mut out = vec![0.0; n_tokens * channels];
    // Bands do not cross groups: those of a group are followed by those of the next.
    let mut bands = Vec::new();
    let mut rest = out.as_mut_slice();
    for first in (0..n_tokens).step_by(group) {
        for begin in (0..group).step_by(BAND_QUERIES) {
            let n = BAND_QUERIES.min(group - begin);
            let (band, tail) = rest.split_at_mut(n * channels);
            bands.push((first, first + begin, band));
            rest = tail;
        }
    }
    let scale = 1.0 / (d as f32).sqrt();
    bands
        .into_par_iter()
        .for_each_init(Vec::new, |scores, (first, begin, out)| {
            let n = out.len() / channels;
            scores.resize(n * group, 0.0);
            for head in 0..n_heads {
                let part = |token: usize, part: usize, rows: usize| Strided {
                    values: &qkv[token * row + part * channels + head * d..],
                    rows,
                    columns: d,
                    row,
                    column: 1,
                };
                let keys = part(first, 1, group).transposed();
                multiply(scores, group, scale, part(begin, 0, n), keys);
                let inverse_sums: Vec<f32> =
                    scores.chunks_exact_mut(group).map(exponentials).collect();
                let out = &mut out[head * d..];
                let weights = Strided::rows(scores, n, group);
                multiply(out, channels, 1.0, weights, part(first, 2, group));
                for (row, inverse) in out.chunks_mut(channels).zip(inverse_sums) {
                    row[..d].iter_mut().for_each(|value| *value *= inverse);
                }
            }
        });
    out
}
