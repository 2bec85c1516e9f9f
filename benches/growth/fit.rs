//! `y = c x^e` through points, by least squares in the logarithms.

/// The exponent `e`; NaN for fewer than two sizes.
pub(crate) fn exponent(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let covariance: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    covariance / variance
}

/// # Panics
/// If known exponents are not found again.
pub(crate) fn check() {
    for e in [-1.0, 0.0, 0.5, 1.0, 2.0] {
        let of = |x: f64| (x, 3.0 * x.powf(e));
        let found = exponent(&[of(10.0), of(25.0), of(1e4)]);
        assert!((found - e).abs() < 1e-12, "{found} for {e}");
    }
    // Off on one side by a factor 1.1, and on the other: the slope of two points through the middle.
    let bent = exponent(&[(1.0, 1.1), (10.0, 10.0), (100.0, 90.0)]);
    assert!(
        (bent - 0.5 * (90.0_f64 / 1.1).log10()).abs() < 1e-12,
        "{bent}"
    );
}
