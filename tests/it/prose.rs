//! Sentences are short, as STYLE.md asks for.

use std::fs;
use std::path::Path;

/// The most words that a document's sentences have on average.
const MOST: f64 = 16.0;

#[test]
fn sentences_of_the_readme_are_short() {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).expect("a README");
    let sentences = sentences(&text);
    let words: usize = sentences.iter().map(|sentence| count_words(sentence)).sum();
    let mean = words as f64 / sentences.len() as f64;
    let longest = sentences.iter().max_by_key(|sentence| count_words(sentence)).expect("sentences");
    assert!(mean <= MOST, "{} sentences have {mean:.1} words on average; the longest is\n{longest}", sentences.len());
    assert!(sentences.len() > 30, "only {} sentences are found", sentences.len());
}

#[test]
fn sentences_are_told_apart() {
    let text = "# Head\n\nOne two,\nthree. [Four](a.b) `five.six` seven: eight?\n\n```\nNo code. None.\n```\n\n- An item\n- Two\n\n| no | table |\n";
    assert_eq!(sentences(text), ["One two, three.", "[Four](a.b) `five.six` seven: eight?", "An item", "Two"]);
    assert_eq!(sentences(text).iter().map(|s| count_words(s)).collect::<Vec<_>>(), [3, 4, 2, 1]);
}

/// The sentences of a document in Markdown, without headings, tables and code.
fn sentences(text: &str) -> Vec<String> {
    // Outside of code: every second part.
    let prose: String = text.split("```").step_by(2).collect::<Vec<_>>().join("\n\n");
    let mut paragraphs = vec![String::new()];
    for line in prose.lines().map(str::trim) {
        let item = line.strip_prefix("- ");
        if line.is_empty() || line.starts_with(['#', '|', '!', '<']) || item.is_some() {
            paragraphs.push(String::new());
        }
        let line = item.unwrap_or(line);
        if !line.starts_with(['#', '|', '!', '<']) {
            let last = paragraphs.last_mut().expect("there is one");
            *last += line;
            last.push(' ');
        }
    }
    let ended = |paragraph: String| {
        let mut sentences = vec![String::new()];
        for word in paragraph.split_whitespace() {
            let last = sentences.last_mut().expect("there is one");
            if !last.is_empty() {
                last.push(' ');
            }
            *last += word;
            if word.trim_end_matches(['*', ')', '"']).ends_with(['.', '?', '!']) {
                sentences.push(String::new());
            }
        }
        sentences
    };
    paragraphs.into_iter().flat_map(ended).filter(|sentence| !sentence.is_empty()).collect()
}

/// How many words a sentence has; what is between spaces counts if a letter or digit is in it.
fn count_words(sentence: &str) -> usize {
    sentence.split_whitespace().filter(|word| word.contains(char::is_alphanumeric)).count()
}
