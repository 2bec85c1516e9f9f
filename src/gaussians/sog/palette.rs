//! This module finds few vectors that stand for many.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Vectors, and which of them stands for each of those that they were made of.
pub(super) struct Palette {
    /// One after the other.
    pub(super) entries: Vec<f32>,
    pub(super) labels: Vec<u32>,
}

/// Vectors that one entry stands for, until they are split.
struct Group {
    members: Vec<u32>,
    mean: Vec<f64>,
    /// The number that differs most, and where it is split.
    axis: usize,
    /// Sum of squared differences from the mean.
    error: f64,
}

impl PartialEq for Group {
    fn eq(&self, other: &Group) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Group {}

impl PartialOrd for Group {
    fn partial_cmp(&self, other: &Group) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Group {
    /// Orders by error; of equal ones the group of earlier vectors is larger, so that no chance
    /// decides.
    fn cmp(&self, other: &Group) -> Ordering {
        let by_error = self.error.total_cmp(&other.error);
        by_error.then_with(|| other.members.first().cmp(&self.members.first()))
    }
}

impl Palette {
    /// Finds at most `n` entries for `vectors`, which have `length` numbers each: the group of the
    /// largest error is halved at its mean, along the number that differs most, again and again.
    pub(super) fn of(vectors: &[f32], length: usize, n: usize) -> Palette {
        let n_vectors = vectors.len() / length;
        let group = |members: Vec<u32>| Group::of(members, vectors, length);
        let mut groups = BinaryHeap::from([group((0..n_vectors as u32).collect())]);
        while groups.len() < n {
            match groups.peek() {
                Some(largest) if largest.error > 0.0 => {}
                _ => break,
            }
            let Some(largest) = groups.pop() else { break };
            let middle = largest.mean[largest.axis];
            let is_below =
                |i: &u32| f64::from(vectors[*i as usize * length + largest.axis]) < middle;
            let (below, above): (Vec<u32>, Vec<u32>) =
                largest.members.iter().partition(|i| is_below(i));
            if below.is_empty() || above.is_empty() {
                // All equal but for rounding.
                groups.push(Group {
                    error: 0.0,
                    ..largest
                });
                continue;
            }
            groups.push(group(below));
            groups.push(group(above));
        }
        let mut groups = groups.into_vec();
        groups.sort_by_key(|group| group.members.first().copied());
        let mut labels = vec![0; n_vectors];
        for (label, group) in (0..).zip(&groups) {
            group
                .members
                .iter()
                .for_each(|i| labels[*i as usize] = label);
        }
        let entries = groups.iter().flat_map(|group| &group.mean);
        Palette {
            entries: entries.map(|value| *value as f32).collect(),
            labels,
        }
    }
}

impl Group {
    fn of(members: Vec<u32>, vectors: &[f32], length: usize) -> Group {
        let own = |i: &u32| &vectors[*i as usize * length..][..length];
        let n = members.len().max(1) as f64;
        let mut mean = vec![0.0; length];
        for member in &members {
            for (sum, value) in mean.iter_mut().zip(own(member)) {
                *sum += f64::from(*value) / n;
            }
        }
        let mut errors = vec![0.0; length];
        for member in &members {
            for ((sum, mean), value) in errors.iter_mut().zip(&mean).zip(own(member)) {
                *sum += (f64::from(*value) - mean).powi(2);
            }
        }
        let axis = (0..length).max_by(|a, b| errors[*a].total_cmp(&errors[*b]));
        Group {
            members,
            mean,
            axis: axis.unwrap_or(0),
            error: errors.iter().sum(),
        }
    }
}
