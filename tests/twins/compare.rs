//! Comparisons. A value that is not finite on either side never passes, nor does a length that
//! differs.

/// `|a - b| / |b|` in L2, `|a|` where `b` is 0.
pub fn relative_l2(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "compared arrays differ in length");
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| a - b));
    let reference = norm(&mut b.iter().copied());
    let result = difference / if reference > 0.0 { reference } else { 1.0 };
    if result.is_nan() {
        f64::INFINITY
    } else {
        result
    }
}

/// Largest `|a - b|` over the pixels that `mask` leaves out; arrays are pixel-major with any
/// number of channels.
pub fn max_abs_off_mask(a: &[f64], b: &[f64], mask: &[bool]) -> f64 {
    assert_eq!(a.len(), b.len(), "compared arrays differ in length");
    assert!(
        !mask.is_empty() && a.len().is_multiple_of(mask.len()),
        "the mask does not fit the image"
    );
    let channels = a.len() / mask.len();
    let mut worst = 0.0;
    for (pixel, (a, b)) in a.chunks(channels).zip(b.chunks(channels)).enumerate() {
        for (a, b) in a.iter().zip(b).filter(|_| !mask[pixel]) {
            let difference = (a - b).abs();
            worst = if difference.is_finite() {
                difference.max(worst)
            } else {
                f64::INFINITY
            };
        }
    }
    worst
}

/// Fails, naming `what`, where the relative L2 exceeds `tolerance`.
pub fn assert_relative_l2(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    let difference = relative_l2(a, b);
    assert!(
        difference <= tolerance,
        "{what}: relative L2 {difference:e} > {tolerance:e}"
    );
}

/// Fails, naming `what`, where a pixel off the mask differs by more than `tolerance`.
pub fn assert_close_off_mask(what: &str, a: &[f64], b: &[f64], mask: &[bool], tolerance: f64) {
    let difference = max_abs_off_mask(a, b, mask);
    assert!(
        difference <= tolerance,
        "{what}: differs by {difference:e} > {tolerance:e}"
    );
}
