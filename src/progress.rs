//! Training progress on stderr: a bar on a terminal, else a line every few seconds.

use std::io::Write;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Time between two lines where stderr is no terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows iterations per second, loss, number of Gaussians and time left.
pub struct Progress {
    sink: Sink,
    pace: Pace,
}

struct Pace {
    total: u32,
    /// Iterations that were finished before `start`.
    before: u32,
    start: Instant,
}

enum Sink {
    Bar(ProgressBar),
    Lines {
        out: Box<dyn Write + Send>,
        interval: Duration,
        last: Instant,
        /// The last update, for the final line.
        latest: Option<(u32, f64, usize)>,
    },
}

impl Progress {
    /// Progress on stderr over `total` iterations.
    pub fn new(total: u32) -> Progress {
        let bar = ProgressBar::with_draw_target(
            Some(u64::from(total)),
            ProgressDrawTarget::stderr_with_hz(5),
        );
        if bar.is_hidden() {
            return Self::lines(total, Box::new(std::io::stderr()), LINE_INTERVAL);
        }
        // The template is a constant; were it wrong, the default style would show.
        if let Ok(style) =
            ProgressStyle::with_template("{bar:30} {pos}/{len}  {per_sec}  {msg}  {eta} left")
        {
            bar.set_style(style);
        }
        Progress {
            sink: Sink::Bar(bar),
            pace: Pace::new(total),
        }
    }

    /// Goes on after `done` iterations, whose speed is not known.
    pub fn from(mut self, done: u32) -> Progress {
        self.pace.before = done;
        if let Sink::Bar(bar) = &self.sink {
            bar.set_position(u64::from(done));
            bar.reset_eta();
        }
        self
    }

    /// Plain lines into `out`, at most one an `interval`.
    pub fn lines(total: u32, out: Box<dyn Write + Send>, interval: Duration) -> Progress {
        let pace = Pace::new(total);
        Progress {
            sink: Sink::Lines {
                out,
                interval,
                last: pace.start,
                latest: None,
            },
            pace,
        }
    }

    /// After `iteration` iterations.
    pub fn update(&mut self, iteration: u32, loss: f64, n_gaussians: usize) {
        match &mut self.sink {
            Sink::Bar(bar) => {
                bar.set_message(format!("loss {loss:.4}  {n_gaussians} Gaussians"));
                bar.set_position(u64::from(iteration));
            }
            Sink::Lines {
                out,
                interval,
                last,
                latest,
            } => {
                *latest = Some((iteration, loss, n_gaussians));
                if last.elapsed() >= *interval {
                    *last = Instant::now();
                    // Training goes on when nobody can read how it does.
                    let _ = writeln!(out, "{}", self.pace.line(iteration, loss, n_gaussians));
                    *latest = None;
                }
            }
        }
    }

    /// Leaves the last state on the screen.
    pub fn finish(self) {
        match self.sink {
            Sink::Bar(bar) => bar.abandon(),
            Sink::Lines {
                mut out, latest, ..
            } => {
                if let Some((iteration, loss, n_gaussians)) = latest {
                    let _ = writeln!(out, "{}", self.pace.line(iteration, loss, n_gaussians));
                }
            }
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

    /// `1500/10000  12.3 it/s  loss 0.0812  51234 Gaussians  11m31s left`
    fn line(&self, iteration: u32, loss: f64, n_gaussians: usize) -> String {
        let seconds = self.start.elapsed().as_secs_f64().max(1e-9);
        let per_second = f64::from(iteration.saturating_sub(self.before)) / seconds;
        let left = f64::from(self.total.saturating_sub(iteration)) / per_second;
        format!(
            "{iteration}/{}  {per_second:.1} it/s  loss {loss:.4}  {n_gaussians} Gaussians  \
             {} left",
            self.total,
            short_time(left)
        )
    }
}

/// Seconds as `2h05m`, `11m31s` or `42s`; `?` where unknown.
fn short_time(seconds: f64) -> String {
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
