//! The trainer with a partner takes the steps, changes and room of two sets of Gaussians together.

use std::mem::swap;

use super::capacity::uniform;
use super::partner::apart::apart;
use super::partner::exchange::Exchange;
use super::partner::{self, PSEUDO_SLOT};
use super::policy::Plan;
use super::record::PlanCounts;
use super::schedule;
use super::trainer::{StepViews, Trainer};
use crate::error::Result;
use crate::gpu::Commands;
use crate::render::{LossUniform, Pass, PassStep, Totals, ViewUniform, read_totals};

impl Trainer<'_> {
    /// Does `act` with the partner's set in place of the first; nothing without a partner.
    pub(super) fn in_partner(&mut self, act: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        if self.partner.is_none() {
            return Ok(());
        }
        self.change_places();
        let outcome = act(self);
        self.change_places();
        outcome
    }

    fn change_places(&mut self) {
        if let Some(partner) = &mut self.partner {
            swap(&mut self.optimizer, &mut partner.optimizer);
            swap(&mut self.workspace, &mut partner.workspace);
            swap(&mut self.bound, &mut partner.bound);
            swap(&mut self.adam, &mut partner.adam);
        }
    }

    /// Records iteration `iteration` (from 0) of both sets, of which each learns from the photograph of real view `real`, and
    /// from the other in the pseudo view.
    pub(super) fn record_both(
        &mut self,
        iteration: u32,
        real: usize,
        commands: &mut Commands<'_>,
    ) -> StepViews {
        let (config, supervision) = (self.config, self.supervision);
        let degree = self.sh_degree(iteration);
        let background = schedule::background(config, iteration);
        let view = &supervision.real[real];
        let real_uniform = self.real[real];
        self.set_goal(commands, 0, view, &real_uniform, real, background);
        // Setting a target image fails in no way.
        self.change_places();
        self.set_goal(commands, 0, view, &real_uniform, real, background);
        self.change_places();
        let mut views = StepViews {
            real,
            virtual_view: None,
            pseudo_view: false,
        };
        let Some(partner) = &self.partner else {
            return views;
        };
        let own = schedule::dropout(config, iteration);
        let dropouts = [own, own.of_other()];
        let sets = [
            (&self.workspace, &self.bound, &self.optimizer),
            (&partner.workspace, &partner.bound, &partner.optimizer),
        ];
        let pass = |set: usize, slot: usize, uniform: ViewUniform| {
            let (workspace, bound, optimizer) = sets[set];
            let uniform = uniform.before(background);
            Pass::new(
                self.gpu,
                self.kernels,
                workspace,
                bound,
                &optimizer.model,
                uniform.with_dropout(dropouts[set].rate, dropouts[set].key),
                PassStep {
                    slot,
                    sh_degree: degree,
                    number: iteration + 1,
                },
            )
        };
        let w = config.loss.ssim_weight;
        let loss = LossUniform::new(view.weight, w, view.total_weight, view.masked);
        for set in [0, 1] {
            let pass = pass(set, 0, real_uniform);
            pass.forward(commands);
            pass.loss(commands, loss);
            pass.backward(commands);
        }
        let mut centers = vec![real_uniform.center()];
        if partner::shows_pseudo_view(config, iteration)
            && let Some(exchange) = &partner.exchange
        {
            let camera = partner.ellipse.camera(config.seed, iteration);
            let pseudo = uniform(&camera, supervision, config);
            let passes = [0, 1].map(|set| pass(set, PSEUDO_SLOT, pseudo));
            passes.iter().for_each(|pass| pass.forward(commands));
            exchange.hand_over(commands, &partner.kernels, &pseudo);
            let n_pixels = pseudo.n_pixels() as f64;
            let loss = LossUniform::new(config.partner.weight, w, n_pixels, false);
            for pass in &passes {
                pass.loss(commands, loss);
                pass.backward(commands);
            }
            centers.push(pseudo.center());
            views.pseudo_view = true;
        }
        if let Some(exchange) = &partner.exchange {
            exchange.share_overflow(commands, &partner.kernels);
        }
        let step = self.step_uniform(iteration, &centers);
        for (optimizer, adam) in [
            (&self.optimizer, &self.adam),
            (&partner.optimizer, &partner.adam),
        ] {
            optimizer.step(
                self.gpu,
                &self.optimizer_kernels,
                adam,
                commands,
                step,
                degree,
            );
        }
        views
    }

    /// Binds what both sets hand over anew.
    pub(super) fn rebind_exchange(&mut self) {
        if let Some(partner) = &mut self.partner {
            let spaces = [&self.workspace, &partner.workspace];
            partner.exchange = Some(Exchange::new(self.gpu, &partner.kernels, spaces));
        }
    }

    /// Makes room for both if a step of either did not fit; as [`Trainer::make_room`], where the first set's counts
    /// are `own`.
    pub(super) fn make_room_for_both(&mut self, own: &Totals) -> Result<Option<u32>> {
        let Some(partner) = &self.partner else {
            return Ok(None);
        };
        let other = read_totals(self.gpu, &partner.workspace)?;
        let Some([own_room, other_room]) = Totals::rooms([own, &other], self.gpu)? else {
            return Ok(None);
        };
        self.grow(own_room)?;
        self.in_partner(|trainer| trainer.grow(other_room))?;
        Ok(Some(own.overflow_step - 1))
    }

    /// Removes the Gaussians of both sets that stand apart from all of the other's, as both were before.
    ///
    /// # Errors
    /// A GPU fault.
    pub(super) fn prune_apart(&mut self, done: u32) -> Result<()> {
        let Some(partner) = &self.partner else {
            return Ok(());
        };
        let own = self.optimizer.model.means(self.gpu)?;
        let other = partner.optimizer.model.means(self.gpu)?;
        let frozen_beyond = self.supervision.frozen_beyond();
        let distance = self.config.partner.prune_distance;
        let plan = |means: &[glam::Vec3], others: &[glam::Vec3]| {
            let apart = apart(means, others, distance);
            // Those of the far shell stay.
            let stays = means.iter().zip(apart);
            let stays = stays.map(|(mean, apart)| !apart || mean.length() > frozen_beyond);
            let stays: Vec<bool> = stays.collect();
            let counts = PlanCounts {
                pruned_apart: stays.iter().filter(|stays| !**stays).count(),
                ..PlanCounts::default()
            };
            Plan::of_those_that_stay(&stays, counts)
        };
        let (own, other) = (plan(&own, &other), plan(&other, &own));
        if own.counts.pruned_apart > 0 {
            self.rearrange(&own, false, done)?;
        }
        if other.counts.pruned_apart > 0 {
            self.in_partner(|trainer| trainer.carry_out(&other, false))?;
        }
        Ok(())
    }
}
