//! The convolutional parts of AlexNet (Krizhevsky 2014, torchvision's) and VGG16 (Simonyan and
//! Zisserman 2015), cut into slices as the LPIPS package cuts them.

use super::Net;

/// A convolution as the net's definition states it.
pub(super) struct ConvSpec {
    /// Number in torchvision's list of layers, and so in the tensors' names.
    pub index: usize,
    pub n_in: usize,
    pub n_out: usize,
    pub side: usize,
    pub stride: usize,
    pub padding: usize,
}

/// A slice: an optional pooling (side, stride), then convolutions with ReLU.
pub(super) struct SliceSpec {
    pub pool: Option<(usize, usize)>,
    pub convs: &'static [ConvSpec],
}

/// Defines a convolution of stride 1 that keeps the size.
const fn same(index: usize, n_in: usize, n_out: usize, side: usize) -> ConvSpec {
    ConvSpec {
        index,
        n_in,
        n_out,
        side,
        stride: 1,
        padding: side / 2,
    }
}

const fn slice(pool: Option<(usize, usize)>, convs: &'static [ConvSpec]) -> SliceSpec {
    SliceSpec { pool, convs }
}

const ALEX: &[SliceSpec] = &[
    slice(
        None,
        &[ConvSpec {
            index: 0,
            n_in: 3,
            n_out: 64,
            side: 11,
            stride: 4,
            padding: 2,
        }],
    ),
    slice(Some((3, 2)), &[same(3, 64, 192, 5)]),
    slice(Some((3, 2)), &[same(6, 192, 384, 3)]),
    slice(None, &[same(8, 384, 256, 3)]),
    slice(None, &[same(10, 256, 256, 3)]),
];

const VGG: &[SliceSpec] = &[
    slice(None, &[same(0, 3, 64, 3), same(2, 64, 64, 3)]),
    slice(Some((2, 2)), &[same(5, 64, 128, 3), same(7, 128, 128, 3)]),
    slice(
        Some((2, 2)),
        &[
            same(10, 128, 256, 3),
            same(12, 256, 256, 3),
            same(14, 256, 256, 3),
        ],
    ),
    slice(
        Some((2, 2)),
        &[
            same(17, 256, 512, 3),
            same(19, 512, 512, 3),
            same(21, 512, 512, 3),
        ],
    ),
    slice(
        Some((2, 2)),
        &[
            same(24, 512, 512, 3),
            same(26, 512, 512, 3),
            same(28, 512, 512, 3),
        ],
    ),
];

impl Net {
    pub(super) const ALL: [Net; 2] = [Net::Alex, Net::Vgg];

    pub(super) fn slices(self) -> &'static [SliceSpec] {
        match self {
            Net::Alex => ALEX,
            Net::Vgg => VGG,
        }
    }

    /// Returns the shortest side of an image that leaves the last slice a pixel, backwards from
    /// that one.
    pub(super) fn min_side_px(self) -> u32 {
        let mut side = 1;
        for slice in self.slices().iter().rev() {
            for conv in slice.convs.iter().rev() {
                side = (side - 1) * conv.stride + conv.side;
                side = side.saturating_sub(2 * conv.padding).max(1);
            }
            if let Some((pool, stride)) = slice.pool {
                side = (side - 1) * stride + pool;
            }
        }
        side as u32
    }
}
