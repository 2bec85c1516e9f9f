//! The lock lets one process at a time write a run directory.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::Path;

use crate::error::{Error, Result};

/// The file whose lock it is. It stays: what counts is the lock, which the system releases with
/// the process, however that ends.
pub(crate) const LOCK_FILE: &str = ".lock";

/// The lock of a run directory, held by the process that writes it and released when dropped.
#[derive(Debug)]
pub(crate) struct RunLock {
    _file: File,
}

impl RunLock {
    /// Locks the directory `root`, which exists.
    ///
    /// # Errors
    /// Another process holds the lock.
    pub(crate) fn take(root: &Path) -> Result<RunLock> {
        let file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .open(root.join(LOCK_FILE))
            .map_err(|e| Error::new(format!("cannot write there: {e}")).at_path(root))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(Error::new("another gspotential is at work on this run")
                    .at_path(root)
                    .way_out("wait until it has ended, or choose another run directory"));
            }
            // Some network file systems have no locks; that is no reason not to train.
            Err(TryLockError::Error(e)) => log::warn!(
                "{}: cannot be locked ({e}); let no other process write there",
                root.display()
            ),
        }
        Ok(RunLock { _file: file })
    }
}
