//! How many there are, in words that agree with it.

/// "1 line", "2 lines": one is never many.
#[must_use]
pub fn counted(count: usize, one: &str, many: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {many}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many_and_none_is() {
        let words = [0, 1, 2].map(|count| counted(count, "lens", "lenses"));
        assert_eq!(words, ["0 lenses", "1 lens", "2 lenses"]);
    }
}
