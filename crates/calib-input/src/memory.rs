//! Memory that is asked for before it is taken.

use std::fmt;

/// There is not as much memory as is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory {
    /// What was asked for, in bytes.
    pub bytes: u64,
}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "needs {} MiB of memory, more than there is", self.bytes >> 20)
    }
}

impl std::error::Error for OutOfMemory {}

/// Whether so many bytes are there to be taken: a library that takes them without asking would end the
/// whole program. Where the system promises more than it has, this is its promise.
///
/// # Errors
/// When they are not.
pub fn room_for(bytes: u64) -> Result<(), OutOfMemory> {
    reserved(bytes).map(drop)
}

/// An empty buffer with room for so many bytes.
pub(crate) fn reserved(bytes: u64) -> Result<Vec<u8>, OutOfMemory> {
    let mut buffer = Vec::new();
    let count = usize::try_from(bytes).map_err(|_| OutOfMemory { bytes })?;
    buffer.try_reserve_exact(count).map_err(|_| OutOfMemory { bytes })?;
    Ok(buffer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_machine_has_is_an_error() {
        assert_eq!(room_for(u64::MAX), Err(OutOfMemory { bytes: u64::MAX }));
        assert_eq!(room_for(1 << 20), Ok(()));
    }
}
