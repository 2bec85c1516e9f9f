//! This module chooses the view in whose frame the others are found.

/// Chooses the view whose class token is the most ordinary in three measures: mean cosine to the
/// others, length, and variance of its direction; the first of equals. `tokens` are of at least two
/// views.
pub(super) fn choose(tokens: &[&[f32]]) -> usize {
    let n = tokens.len() as f64;
    let tokens: Vec<Vec<f64>> = tokens
        .iter()
        .map(|token| token.iter().map(|x| f64::from(*x)).collect())
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let lengths: Vec<f64> = tokens
        .iter()
        .map(|token| dot(token, token).sqrt())
        .collect();
    let units: Vec<Vec<f64>> = tokens
        .iter()
        .zip(&lengths)
        .map(|(token, length)| token.iter().map(|x| x / length.max(1e-12)).collect())
        .collect();
    let similarity =
        |u: &Vec<f64>| (units.iter().map(|v| dot(u, v)).sum::<f64>() - 1.0) / (n - 1.0);
    let variance = |u: &Vec<f64>| {
        let mean = u.iter().sum::<f64>() / u.len() as f64;
        u.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (u.len() as f64 - 1.0)
    };
    let measures = [
        units.iter().map(similarity).collect(),
        lengths,
        units.iter().map(variance).collect::<Vec<f64>>(),
    ];
    let mut scores = vec![0.0; tokens.len()];
    for measure in measures {
        let min = measure.iter().copied().fold(f64::INFINITY, f64::min);
        let max = measure.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (score, value) in scores.iter_mut().zip(measure) {
            *score += ((value - min) / (max - min + 1e-8) - 0.5).abs();
        }
    }
    let best = scores.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    best.map_or(0, |(view, _)| view)
}
