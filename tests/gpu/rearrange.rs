//! Carrying out a plan, and the opacity reset.

use gspotential::doctor::changes::{
    RESET_WITHIN, SetSize, examine_rearrange, examine_reset, optimizer, random_plan,
};
use gspotential::train::policy::Plan;

use super::rig::{assert_findings, context};

#[test]
fn plans_are_carried_out_to_the_bit_at_every_degree() {
    let (n, stride) = (150, 180);
    let ctx = context();
    for degree in 0..4 {
        // Fewer, within the room that there is, and more.
        for (i, len) in [40, 170, 333].into_iter().enumerate() {
            let plan = random_plan(n, len, 10 * u64::from(degree) + i as u64);
            let found = examine_rearrange(&ctx, &plan, SetSize { n, stride }, degree);
            assert_findings(&found.expect("the new set fits"));
        }
    }
}

#[test]
fn a_plan_that_keeps_nothing_leaves_an_empty_set() {
    let found = examine_rearrange(
        &context(),
        &Plan::default(),
        SetSize { n: 20, stride: 20 },
        1,
    );
    assert_findings(&found.expect("nothing fits anywhere"));
}

#[test]
fn opacities_fall_to_the_ceiling_and_their_moments_to_zero_but_far_out() {
    let ctx = context();
    assert_findings(&examine_reset(&ctx, 70).expect("resets"));
    // There is something to reset, near and far.
    let before = optimizer(&ctx, 70, 75, 1).expect("fits");
    let before = before.model.download(&ctx.gpu).expect("readable");
    for is_far in [false, true] {
        let own = (0..70).filter(|i| (before.means[*i].length() > RESET_WITHIN) == is_far);
        let logits: Vec<f32> = own.map(|i| before.opacity_logits[i]).collect();
        assert!(logits.iter().any(|logit| *logit > -0.8), "{logits:?}");
        assert!(logits.iter().any(|logit| *logit < -0.9), "{logits:?}");
    }
}
