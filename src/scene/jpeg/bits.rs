//! This module reads the bits of a scan and its Huffman codes (ITU-T T.81, Annexes C and F).

use super::MARKER;

/// The reason for which reading ends.
pub(super) enum Stop {
    /// There are no more bits.
    Ended,
    /// No such code.
    Damaged,
}

/// The bits up to a restart marker, or the end of the data.
pub(super) struct Bits<'a> {
    data: &'a [u8],
    /// The next bits, topmost first; what is not there is 0.
    buffer: u64,
    /// How many of them are there.
    n: u32,
}

impl<'a> Bits<'a> {
    pub(crate) fn new(data: &'a [u8]) -> Bits<'a> {
        Bits {
            data,
            buffer: 0,
            n: 0,
        }
    }

    /// Fills the buffer from bytes, of which 0xff is followed by a 0 unless it begins a marker.
    fn refill(&mut self) {
        while self.n <= 56 {
            let (byte, length) = match self.data {
                [MARKER, 0, ..] => (MARKER, 2),
                [MARKER, ..] | [] => return,
                [byte, ..] => (*byte, 1),
            };
            self.data = &self.data[length..];
            self.buffer |= u64::from(byte) << (56 - self.n);
            self.n += 8;
        }
    }

    /// Takes the next `n` bits, at most 16.
    pub(crate) fn take(&mut self, n: u32) -> Result<u32, Stop> {
        if self.n < n {
            self.refill();
            if self.n < n {
                return Err(Stop::Ended);
            }
        }
        let bits = (self.buffer >> 48) as u32 >> (16 - n);
        self.buffer <<= n;
        self.n -= n;
        Ok(bits)
    }

    pub(crate) fn symbol(&mut self, table: &Table) -> Result<u8, Stop> {
        if self.n < 16 {
            self.refill();
        }
        let next = (self.buffer >> 48) as u32;
        let length = (1..=16).find(|length| next < table.ends[*length]);
        let Some(length) = length.filter(|length| *length as u32 <= self.n) else {
            return Err(if self.n < 16 {
                Stop::Ended
            } else {
                Stop::Damaged
            });
        };
        let code = next >> (16 - length);
        let place = table.first[length].wrapping_add(code) as usize;
        self.take(length as u32)?;
        table.symbols.get(place).copied().ok_or(Stop::Damaged)
    }

    /// Goes on behind the next restart marker, if that is what comes next.
    pub(crate) fn restart(&mut self) -> Result<(), Stop> {
        let pads = self.data.iter().take_while(|byte| **byte == MARKER).count();
        match self.data.get(pads) {
            Some(0xd0..=0xd7) if pads > 0 => {
                *self = Bits::new(&self.data[pads + 1..]);
                Ok(())
            }
            None => Err(Stop::Ended),
            Some(_) => Err(Stop::Damaged),
        }
    }
}

/// A Huffman table.
pub(super) struct Table {
    /// By length: where its codes end, as 16 bits from the top, which those of shorter ones do
    /// below.
    ends: [u32; 17],
    /// By length: what is added to a code for its place in `symbols`, modulo 2^32.
    first: [u32; 17],
    symbols: Vec<u8>,
}

impl Table {
    /// Makes the table from the number of codes of each length from 1 to 16, and the symbols in
    /// order.
    pub(crate) fn new(counts: &[u8; 16], symbols: &[u8]) -> Table {
        let mut table = Table {
            ends: [0; 17],
            first: [0; 17],
            symbols: symbols.to_vec(),
        };
        let (mut code, mut place) = (0_u32, 0_u32);
        for (length, count) in (1..).zip(counts) {
            code <<= 1;
            table.first[length] = place.wrapping_sub(code);
            code += u32::from(*count);
            place += u32::from(*count);
            table.ends[length] = code << (16 - length);
        }
        table
    }
}
