//! Python's `json` writes NaN and infinities as bare words, which are no JSON.

use std::borrow::Cow;

const WORDS: [&[u8]; 3] = [b"-Infinity", b"Infinity", b"NaN"];

/// Returns `json` with these words quoted, so that what needs a number there is told of a word, and
/// what is not looked at does no harm.
pub(crate) fn quoted_nan(json: &[u8]) -> Cow<'_, [u8]> {
    let has = |word: &&[u8]| json.windows(word.len()).any(|bytes| bytes == *word);
    if !WORDS[1..].iter().any(has) {
        return Cow::Borrowed(json);
    }
    let mut quoted = Vec::with_capacity(json.len() + 64);
    let (mut at, mut in_string) = (0, false);
    while at < json.len() {
        let rest = &json[at..];
        let word = WORDS
            .iter()
            .find(|word| !in_string && rest.starts_with(word));
        let n = match (word, rest[0]) {
            (Some(word), _) => {
                quoted.push(b'"');
                quoted.extend_from_slice(word);
                quoted.push(b'"');
                at += word.len();
                continue;
            }
            // What is escaped ends no string.
            (None, b'\\') if in_string => rest.len().min(2),
            (None, b'"') => {
                in_string = !in_string;
                1
            }
            _ => 1,
        };
        quoted.extend_from_slice(&rest[..n]);
        at += n;
    }
    Cow::Owned(quoted)
}

/// Returns whether a value is one of the words as [`quoted_nan`] leaves them.
pub(crate) fn is_not_finite(value: &serde_json::Value) -> bool {
    let word = value.as_str().unwrap_or_default().as_bytes();
    WORDS.contains(&word)
}
