//! Adam as PyTorch does it.

/// Decay rates of Adam, and the term that keeps the divisor from 0.
#[derive(Clone, Copy, Debug)]
pub struct TwinAdam {
    /// Decay of the first moment, a step.
    pub beta1: f64,
    /// Decay of the second moment, a step.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
}

impl TwinAdam {
    /// Takes step number `step` (from 1) of one parameter with moments `[m, v]`:
    /// `p -= lr * m_hat / (sqrt(v_hat) + epsilon)`.
    pub fn step(
        &self,
        parameter: &mut f64,
        moments: &mut [f64; 2],
        gradient: f64,
        learning_rate: f64,
        step: i32,
    ) {
        moments[0] = self.beta1 * moments[0] + (1.0 - self.beta1) * gradient;
        moments[1] = self.beta2 * moments[1] + (1.0 - self.beta2) * gradient * gradient;
        let m_hat = moments[0] / (1.0 - self.beta1.powi(step));
        let v_hat = moments[1] / (1.0 - self.beta2.powi(step));
        *parameter -= learning_rate * m_hat / (v_hat.sqrt() + self.epsilon);
    }
}
