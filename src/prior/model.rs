//! This module tells which model a file of weights holds, by its tensors' shapes.

use super::DOWNLOAD;
use super::weights::Weights;
use crate::error::{Error, Result};

/// What the shapes do not tell: the blocks whose outputs the head takes, by the number of blocks.
/// The first entry is that of models of a few thousand parameters, for tests.
const OUTPUTS: [(usize, [usize; 4]); 4] = [
    (8, [3, 5, 6, 7]),
    (12, [5, 7, 9, 11]),
    (24, [11, 15, 19, 23]),
    (40, [19, 27, 33, 39]),
];

/// Widest model whose weights are under Apache-2.0; those of wider ones are CC BY-NC 4.0.
const WIDEST_FREE: usize = 768;

/// Sizes of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Model {
    /// Width of the embedding.
    pub channels: usize,
    /// Attention heads of a block.
    pub n_heads: usize,
    /// Blocks of the transformer.
    pub n_blocks: usize,
    /// First block with camera tokens, turned queries and keys, and attention over all views.
    pub alt_start: usize,
    /// Blocks whose outputs the head takes.
    pub outputs: [usize; 4],
    /// Channels of the head's maps.
    pub features: usize,
    /// Channels of the four projections in the head, one for each of `outputs`.
    pub out_channels: [usize; 4],
    /// Numbers in the file of weights.
    pub n_parameters: u64,
}

impl Model {
    /// Tells the model.
    ///
    /// # Errors
    /// None of the any-view models.
    pub(super) fn of(weights: &Weights) -> Result<Model> {
        refuse_others(weights).map_err(|e| e.at_path(weights.path()))?;
        let model = sizes(weights).ok_or_else(|| {
            Error::new("holds no Depth Anything 3 model that is known here")
                .at_path(weights.path())
                .way_out(DOWNLOAD)
        })?;
        Ok(model)
    }

    /// Returns the name in Depth Anything 3's tables, or the width.
    pub fn name(&self) -> String {
        match (self.channels, self.n_blocks) {
            (384, 12) => "DA3-SMALL".to_owned(),
            (768, 12) => "DA3-BASE".to_owned(),
            (1024, 24) => "DA3-LARGE".to_owned(),
            (1536, 40) => "DA3-GIANT".to_owned(),
            (channels, blocks) => format!("a model of {blocks} blocks, {channels} wide"),
        }
    }

    /// Returns what has to be said of the weights' licence before their results are used.
    pub fn licence_notice(&self) -> Option<&'static str> {
        (self.channels > WIDEST_FREE).then_some(
            "these weights are under CC BY-NC 4.0: not for commercial use, and with attribution; what \
             is made with them inherits the question (DA3-SMALL and DA3-BASE are under Apache-2.0)",
        )
    }
}

/// Refuses models of the same family that have another layout.
fn refuse_others(weights: &Weights) -> Result<()> {
    let has = |part: &str| weights.names().any(|name| name.contains(part));
    let what = if has("model.da3.") || has("da3_metric") {
        "holds the nested model of two networks"
    } else if has("sky_output_conv2") {
        "holds a model for one view (mono or metric), which finds no cameras"
    } else if !has("backbone.pretrained.blocks.0.") {
        "holds no vision transformer as Depth Anything 3 has it"
    } else if weights.shape("backbone.pretrained.cls_token").is_none() {
        "names its tensors otherwise than the released files (`model.backbone.pretrained...`)"
    } else {
        return Ok(());
    };
    Err(Error::new(what).way_out(format!("any-view models are read: {DOWNLOAD}")))
}

fn sizes(weights: &Weights) -> Option<Model> {
    let first = |name: &str| weights.shape(name).and_then(|shape| shape.first().copied());
    let block = |i: usize, part: &str| first(&format!("backbone.pretrained.blocks.{i}.{part}"));
    let channels = *weights.shape("backbone.pretrained.cls_token")?.last()?;
    // The highest number counts: where a tensor of a block is missing the file is damaged, not
    // another.
    let number = |name: String| {
        let (_, rest) = name.split_once("backbone.pretrained.blocks.")?;
        rest.split_once('.')?.0.parse::<usize>().ok()
    };
    let n_blocks = weights.names().filter_map(number).max()?.checked_add(1)?;
    let (_, outputs) = *OUTPUTS.iter().find(|(n, _)| *n == n_blocks)?;
    // Any of the four tells where they begin: where one is missing the file is damaged, not
    // another.
    let qk_norm = |i: usize| {
        let parts = [
            "q_norm.weight",
            "q_norm.bias",
            "k_norm.weight",
            "k_norm.bias",
        ];
        parts
            .iter()
            .find_map(|part| block(i, &format!("attn.{part}")))
    };
    let (alt_start, head_dim) = (0..n_blocks).find_map(|i| Some((i, qk_norm(i)?)))?;
    let mut out_channels = [0; 4];
    for (k, n) in out_channels.iter_mut().enumerate() {
        *n = first(&format!("head.projects.{k}.weight"))?;
    }
    let features = first("head.scratch.layer1_rn.weight")?;
    let model = Model {
        channels,
        n_heads: channels.checked_div(head_dim)?,
        n_blocks,
        alt_start,
        outputs,
        features,
        out_channels,
        n_parameters: weights.n_parameters(),
    };
    // What the layers divide by and by how much.
    let whole = head_dim.is_multiple_of(4)
        && model.n_heads > 0
        && channels == model.n_heads * head_dim
        && channels.is_multiple_of(16)
        && features > 0
        && features.is_multiple_of(8)
        && out_channels.iter().all(|n| *n > 0 && n.is_multiple_of(4))
        && alt_start >= 2;
    whole.then_some(model)
}
