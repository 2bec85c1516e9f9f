//! This module shows progress on stderr: a bar on a terminal, else a line every few seconds.

use std::io::Write;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use log::LevelFilter;
use serde_json::json;

use crate::terminal::logging::{self, Style};

/// Time between two lines where stderr is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows how far a stage is, how fast it goes and the time left.
pub struct Progress {
    sink: Sink,
    stage: &'static str,
    pace: Pace,
}

/// How fast a stage goes.
#[derive(Clone, Copy)]
struct Pace {
    total: u32,
    /// Iterations that were finished before `start`.
    before: u32,
    start: Instant,
}

enum Sink {
    Bar(ProgressBar),
    Lines {
        style: Style,
        out: Box<dyn Write + Send>,
        interval: Duration,
        last: Instant,
        /// The last update, for the final line.
        latest: Option<State>,
    },
    Nothing,
}

/// How far a stage is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct State {
    done: u32,
    /// Loss and number of Gaussians.
    training: Option<(f64, usize)>,
}

impl Progress {
    /// Shows the progress of training over `total` iterations.
    pub fn new(total: u32) -> Progress {
        Self::stage("training", total)
    }

    /// Shows the progress of `stage` over `total` steps, as [`logging::start`] has set it.
    pub fn stage(stage: &'static str, total: u32) -> Progress {
        let shown = |sink| Progress {
            sink,
            stage,
            pace: Pace::new(total),
        };
        if log::max_level() < LevelFilter::Info {
            return shown(Sink::Nothing);
        }
        let style = logging::style();
        let bar = ProgressBar::with_draw_target(
            Some(u64::from(total)),
            ProgressDrawTarget::stderr_with_hz(5),
        );
        if bar.is_hidden() || style == Style::Json {
            return shown(Sink::lines(
                style,
                Box::new(std::io::stderr()),
                LINE_INTERVAL,
            ));
        }
        // The template is a constant; were it wrong, the default style would show.
        let template = "{prefix} {bar:30} {pos}/{len}  {per_sec}  {msg}  {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(stage);
        shown(Sink::Bar(bar))
    }

    /// Goes on after `done` steps, whose speed is not known.
    pub fn from(mut self, done: u32) -> Progress {
        self.pace.before = done;
        if let Sink::Bar(bar) = &self.sink {
            bar.set_position(u64::from(done));
            bar.reset_eta();
        }
        self
    }

    /// Learns that the stage has been decided to have so many steps.
    pub fn ends(&mut self, total: u32) {
        self.pace.total = total;
        if let Sink::Bar(bar) = &self.sink {
            bar.set_length(u64::from(total));
        }
    }

    /// Writes training's lines in a style to `out`, at most one an `interval`.
    pub fn lines(
        style: Style,
        total: u32,
        out: Box<dyn Write + Send>,
        interval: Duration,
    ) -> Progress {
        Progress {
            sink: Sink::lines(style, out, interval),
            stage: "training",
            pace: Pace::new(total),
        }
    }

    /// Shows where training stands after `iteration` iterations.
    pub fn update(&mut self, iteration: u32, loss: f64, n_gaussians: usize) {
        self.show(State {
            done: iteration,
            training: Some((loss, n_gaussians)),
        });
    }

    /// Shows where another stage stands after `done` steps.
    pub fn advance(&mut self, done: u32) {
        self.show(State {
            done,
            training: None,
        });
    }

    fn show(&mut self, state: State) {
        let (stage, pace) = (self.stage, self.pace);
        match &mut self.sink {
            Sink::Bar(bar) => {
                bar.set_message(state.detail());
                bar.set_position(u64::from(state.done));
            }
            Sink::Lines {
                style,
                out,
                interval,
                last,
                latest,
            } => {
                *latest = Some(state);
                if last.elapsed() >= *interval {
                    *last = Instant::now();
                    // Training goes on when nobody can read how it does.
                    let _ = writeln!(out, "{}", state.line(*style, stage, pace));
                    *latest = None;
                }
            }
            Sink::Nothing => {}
        }
    }

    /// Returns the steps a second and the seconds left after `done` steps; infinite or NaN before
    /// the first.
    pub fn pace(&self, done: u32) -> (f64, f64) {
        self.pace.at(done)
    }

    /// Leaves the last state on the screen.
    pub fn finish(self) {
        match self.sink {
            Sink::Bar(bar) => bar.abandon(),
            Sink::Lines {
                style,
                mut out,
                latest,
                ..
            } => {
                if let Some(state) = latest {
                    let _ = writeln!(out, "{}", state.line(style, self.stage, self.pace));
                }
            }
            Sink::Nothing => {}
        }
    }
}

impl Sink {
    fn lines(style: Style, out: Box<dyn Write + Send>, interval: Duration) -> Sink {
        Sink::Lines {
            style,
            out,
            interval,
            last: Instant::now(),
            latest: None,
        }
    }
}

impl Pace {
    fn new(total: u32) -> Pace {
        Pace {
            total,
            before: 0,
            start: Instant::now(),
        }
    }

    /// Steps a second, and seconds left; infinite or NaN before the first step.
    fn at(&self, done: u32) -> (f64, f64) {
        let seconds = self.start.elapsed().as_secs_f64().max(1e-9);
        let per_second = f64::from(done.saturating_sub(self.before)) / seconds;
        let left = f64::from(self.total.saturating_sub(done)) / per_second;
        (per_second, left)
    }
}

impl State {
    fn detail(&self) -> String {
        self.training.map_or_else(String::new, |(loss, n)| {
            format!("loss {loss:.4}  {n} Gaussians")
        })
    }

    /// Returns `1500/10000  12.3 it/s  loss 0.0812  51234 Gaussians  11m31s left`, or the same as
    /// JSON.
    fn line(&self, style: Style, stage: &str, pace: Pace) -> String {
        let (done, total) = (self.done, pace.total);
        let (per_second, left) = pace.at(done);
        if style == Style::Json {
            let mut line = json!({
                "level": "progress",
                "stage": stage,
                "done": done,
                "total": total,
                "per_second": per_second,
                // Null before the first step.
                "seconds_left": left,
            });
            if let Some((loss, n)) = self.training {
                line["loss"] = json!(loss);
                line["gaussians"] = json!(n);
            }
            return line.to_string();
        }
        let left = short_time(left);
        match self.training {
            Some(_) => {
                let detail = self.detail();
                format!("{done}/{total}  {per_second:.1} it/s  {detail}  {left} left")
            }
            None if done == total => {
                let taken = short_time(pace.start.elapsed().as_secs_f64());
                format!("{stage}: {done} done in {taken}")
            }
            None => format!("{stage}: {done}/{total}  {left} left"),
        }
    }
}

/// Returns seconds as `2h05m`, `11m31s` or `42s`; `?` where unknown.
pub fn short_time(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "?".to_owned();
    }
    let s = seconds.round() as u64;
    match s {
        0..60 => format!("{s}s"),
        60..3600 => format!("{}m{:02}s", s / 60, s % 60),
        _ => format!("{}h{:02}m", s / 3600, s / 60 % 60),
    }
}
