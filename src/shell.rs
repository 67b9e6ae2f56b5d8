//! Command lines as a person can paste them into a POSIX shell.

/// Joins words into one line. A word with anything that a shell could take for more than text is quoted.
pub fn join<S: AsRef<str>>(words: &[S]) -> String {
    words.iter().map(|word| quote(word.as_ref())).collect::<Vec<String>>().join(" ")
}

fn quote(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./,:=+@".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_shell_would_change_is_quoted() {
        assert_eq!(join(&["cpp-rl", "train", "--seeds", "0..3"]), "cpp-rl train --seeds 0..3");
        assert_eq!(join(&["--out", "it's here"]), r"--out 'it'\''s here'");
        assert_eq!(join(&["", "$HOME", "a*b", "a\"b", "~", "[x]"]), r#"'' '$HOME' 'a*b' 'a"b' '~' '[x]'"#);
    }

    #[cfg(unix)]
    #[test]
    fn a_shell_reads_back_what_was_joined() {
        let words = ["printf", r"%s\n", "a b", "it's", "$(x)", "`y`", "\\", "*", ""];
        let output = std::process::Command::new("sh").args(["-c", &join(&words)]).output().unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), words[2..].join("\n") + "\n");
    }
}
