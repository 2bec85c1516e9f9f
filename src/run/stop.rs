//! Ctrl-C and SIGTERM stop a run gently.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::error::{Error, ErrorKind, Result};

/// A wish to stop. While a [`Gentle`] lives, the first signal only asks, and the second ends the
/// process at once, as every signal does at other times: then there is nothing to save.
#[derive(Clone, Debug)]
pub struct Stop {
    asked: Arc<AtomicBool>,
    at_once: Arc<AtomicBool>,
}

impl Stop {
    /// Returns a stop that only [`Stop::ask`] asks for.
    pub fn unheard() -> Stop {
        Stop {
            asked: Arc::default(),
            at_once: Arc::new(AtomicBool::new(true)),
        }
    }

    /// Returns the stop that SIGINT (Ctrl-C) and SIGTERM ask for, the same in the whole process.
    ///
    /// # Errors
    /// The system refuses the handlers.
    pub fn on_signals() -> Result<Stop> {
        static STOP: OnceLock<Stop> = OnceLock::new();
        if let Some(stop) = STOP.get() {
            return Ok(stop.clone());
        }
        let stop = STOP.get_or_init(Stop::unheard).clone();
        let code = Error::of(ErrorKind::Interrupted, "").exit_code();
        for signal in [SIGINT, SIGTERM] {
            // In this order, so that the signal that asks does not end the process.
            flag::register_conditional_shutdown(signal, code.into(), Arc::clone(&stop.at_once))
                .and_then(|_| flag::register(signal, Arc::clone(&stop.at_once)))
                .and_then(|_| flag::register(signal, Arc::clone(&stop.asked)))
                .map_err(|e| Error::new(format!("cannot listen for Ctrl-C: {e}")))?;
        }
        Ok(stop)
    }

    /// Asks for the stop, as a first signal does.
    pub fn ask(&self) {
        self.asked.store(true, Ordering::SeqCst);
    }

    /// Returns whether a stop has been asked for.
    pub fn asked(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }

    /// Has the first signal only ask: until this is dropped, the caller is expected to look at
    /// [`Stop::asked`].
    pub fn gentle(&self) -> Gentle<'_> {
        self.at_once.store(false, Ordering::SeqCst);
        Gentle(self)
    }
}

/// See [`Stop::gentle`].
pub struct Gentle<'a>(&'a Stop);

impl Drop for Gentle<'_> {
    fn drop(&mut self) {
        self.0.at_once.store(true, Ordering::SeqCst);
    }
}
