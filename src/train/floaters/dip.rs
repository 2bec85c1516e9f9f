//! Hartigan's dip statistic says how far values are from having one mode (Hartigan & Hartigan 1985, "The dip test of
//! unimodality").
//!
//! It is the least distance, the greatest difference at any place, between the distribution of the values and one that is
//! convex up to a mode and concave from it on. Ranks are heights over the sorted values here. The greatest convex
//! minorant of the ranks and their least concave majorant lie farthest apart at a place, and the mode between the knots around it.
//! The interval is narrowed to these, time and again, until that gap is no more than what the parts that were cut off need.

/// Returns the dip of values that are sorted and finite: from `1 / (2 n)` to 1/4, or 0 if all are alike.
pub fn dip(sorted: &[f64]) -> f64 {
    let n = sorted.len();
    if n == 0 || sorted[0] == sorted[n - 1] {
        return 0.0;
    }
    let (mut low, mut high) = (0, n - 1);
    // Twice the dip in ranks. The distribution steps up by 1 at a value, which is off by a half at the least.
    let mut dip: f64 = 1.0;
    loop {
        let convex = Hull::of(sorted, (low, high), 1.0);
        let concave = Hull::of(sorted, (low, high), -1.0);
        let Some((first, last)) = mode(&convex, &concave, dip) else {
            break;
        };
        dip = dip.max(convex.farthest(low, first));
        dip = dip.max(concave.farthest(last, high));
        if (first, last) == (low, high) {
            break;
        }
        (low, high) = (first, last);
    }
    dip / (2.0 * n as f64)
}

/// Returns the ranks of the knots around the place where the hulls lie farthest apart, on the convex and on the concave side;
/// `None` where they nowhere do by more than `least`.
fn mode(convex: &Hull<'_>, concave: &Hull<'_>, least: f64) -> Option<(usize, usize)> {
    let mut widest = least;
    let mut mode = None;
    for &knot in &convex.knots {
        let next = concave.knots.partition_point(|k| *k < knot);
        let gap = concave.above(next, knot).map(|off| off + 1.0);
        if let Some(gap) = gap.filter(|gap| *gap > widest) {
            widest = gap;
            mode = Some((knot, concave.knots[next]));
        }
    }
    for &knot in &concave.knots {
        let next = convex.knots.partition_point(|k| *k < knot);
        let gap = convex.above(next, knot).map(|off| 1.0 - off);
        if let Some(gap) = gap.filter(|gap| *gap > widest) {
            widest = gap;
            mode = Some((convex.knots[next - 1], knot));
        }
    }
    mode
}

/// The hull of ranks over their values, from below or from above.
struct Hull<'a> {
    values: &'a [f64],
    /// Ranks, the first and the last of the interval among them.
    knots: Vec<usize>,
}

impl Hull<'_> {
    /// Makes the hull of the ranks from `low` to `high`: with `side` 1 the convex one below them, with -1 the concave one above.
    fn of(values: &[f64], (low, high): (usize, usize), side: f64) -> Hull<'_> {
        let mut knots: Vec<usize> = Vec::new();
        for i in low..=high {
            while let [.., a, b] = knots[..] {
                let rise = (b - a) as f64 * (values[i] - values[b]);
                let next = (i - b) as f64 * (values[b] - values[a]);
                if side * (rise - next) < 0.0 {
                    break;
                }
                knots.pop();
            }
            knots.push(i);
        }
        Hull { values, knots }
    }

    /// Returns how far the hull lies above rank `i`, which is at or before knot `next` and behind the one before that; `None` on a
    /// knot or a step.
    fn above(&self, next: usize, i: usize) -> Option<f64> {
        let (a, b) = (self.knots[next.checked_sub(1)?], self.knots[next]);
        let width = self.values[b] - self.values[a];
        if i == b || width <= 0.0 {
            return None;
        }
        let share = (self.values[i] - self.values[a]) / width;
        Some((a as f64 - i as f64) + (b - a) as f64 * share)
    }

    /// Returns the greatest distance of the hull between two knots from the distribution, whose step at a value reaches from the rank to
    /// the next.
    fn farthest(&self, from: usize, to: usize) -> f64 {
        let ends = self.knots.iter().enumerate().skip(1);
        let ends = ends.filter(|(k, end)| self.knots[k - 1] >= from && **end <= to);
        let off = |(next, end): (usize, &usize)| {
            let inside = self.knots[next - 1]..*end;
            let distances = inside.filter_map(|i| self.above(next, i));
            distances.fold(0.0, |most: f64, off| most.max(off.abs()))
        };
        1.0 + ends.map(off).fold(0.0, f64::max)
    }
}
