//! The trainer's dropout decides who is left out of an iteration's renders, guided if the config
//! asks for it.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::guide::{Guide, INTERVAL, density_scores};
use super::schedule::Dropout;
use super::trainer::Trainer;
use crate::error::Result;
use crate::render::ViewUniform;

impl Trainer<'_> {
    /// Looks at the Gaussians where the dropout is guided and it is time, before iteration
    /// `iteration` (from 0).
    pub(super) fn guide(&mut self, iteration: u32) -> Result<()> {
        if !(self.config.dropout.is_guided() && iteration.is_multiple_of(INTERVAL)) {
            return Ok(());
        }
        let means = self.optimizer.model.means(self.gpu)?;
        // Those of the far shell are no part of the scene.
        let frozen_beyond = self.supervision.frozen_beyond();
        let scene = |mean: &&Vec3| mean.length() <= frozen_beyond;
        let scene: Vec<Vec3> = means.iter().filter(scene).copied().collect();
        let mut scores = density_scores(&scene).into_iter();
        let score = |mean: &Vec3| {
            let own = (mean.length() <= frozen_beyond).then(|| scores.next());
            own.flatten().unwrap_or(0.0)
        };
        let scores: Vec<f32> = means.iter().map(score).collect();
        self.optimizer.model.set_densities(self.gpu, &scores)?;
        let views = self.real.par_iter().chain(&self.virtual_views);
        let guide = |view: &ViewUniform| {
            let center = DVec3::from_array(view.center.map(f64::from));
            Guide::of(center, &scene)
        };
        self.guides = views.filter_map(guide).collect();
        Ok(())
    }

    /// Returns view `k` of all, the real ones first, with the dropout of an iteration.
    pub(super) fn dropped_out(&self, view: ViewUniform, k: usize, dropout: Dropout) -> ViewUniform {
        let view = view.with_dropout(dropout.rate, dropout.key);
        match self.guides.get(k) {
            Some(guide) => {
                let config = &self.config.dropout;
                guide.applied([config.depth_weight, config.density_weight], view)
            }
            None => view,
        }
    }
}
