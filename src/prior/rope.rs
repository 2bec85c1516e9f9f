//! This is rotary position embedding in two dimensions (Su et al. 2021; Heo et al. 2024).

/// Base of the frequencies.
const BASE: f64 = 100.0;

/// The turns of all tokens of a group, by their rows and columns.
pub(super) struct Rope {
    /// Position in y and x of each token of a group.
    positions: Vec<[usize; 2]>,
    /// Cosines and sines, `[position][frequency]`.
    turns: Vec<[f32; 2]>,
    n_frequencies: usize,
}

impl Rope {
    /// Makes the turns of a grid of patches: the special token is at (0, 0) and patch `(r, c)` at
    /// `(r + 1, c + 1)`.
    pub(crate) fn of_grid(rows: usize, columns: usize, head_dim: usize) -> Rope {
        let patches = (0..rows).flat_map(|r| (0..columns).map(move |c| [r + 1, c + 1]));
        Self::new(std::iter::once([0, 0]).chain(patches).collect(), head_dim)
    }

    /// Makes turns without a place: every patch is at (1, 1), which only tells them from the
    /// special token.
    pub(crate) fn without_place(n_patches: usize, head_dim: usize) -> Rope {
        let patches = std::iter::repeat_n([1, 1], n_patches);
        Self::new(std::iter::once([0, 0]).chain(patches).collect(), head_dim)
    }

    fn new(positions: Vec<[usize; 2]>, head_dim: usize) -> Rope {
        let n_frequencies = head_dim / 4;
        let last = positions.iter().flatten().copied().max().unwrap_or(0);
        let turn = |position: usize, k: usize| {
            let frequency = BASE.powf(-(k as f64) / n_frequencies as f64);
            let angle = position as f64 * frequency;
            [angle.cos() as f32, angle.sin() as f32]
        };
        let turns = (0..=last).flat_map(|p| (0..n_frequencies).map(move |k| turn(p, k)));
        Rope {
            positions,
            turns: turns.collect(),
            n_frequencies,
        }
    }

    /// Turns one head's channels of a token: the first half by y, the second by x. Tokens of
    /// further groups are numbered on.
    pub(crate) fn turn(&self, head: &mut [f32], token: usize) {
        let place = self.positions[token % self.positions.len()];
        let n = self.n_frequencies;
        for (half, position) in head.chunks_exact_mut(2 * n).zip(place) {
            let turns = &self.turns[position * n..][..n];
            let (a, b) = half.split_at_mut(n);
            for ((a, b), [cos, sin]) in a.iter_mut().zip(b).zip(turns) {
                (*a, *b) = (*a * cos - *b * sin, *b * cos + *a * sin);
            }
        }
    }
}
