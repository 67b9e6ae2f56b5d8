//! The page as a browser's parser sees it.

use charts::html::{Block, Column, Figure, Page, Section, Span, Table, Text};
use charts::{About, CurveChart};
use scraper::{ElementRef, Html, Selector};

fn page() -> Page {
    let table = Table {
        caption: Text::from("Returns & steps"),
        columns: vec![Column::text("arm"), Column::numeric("level <0>")],
        rows: vec![vec!["PPO".to_owned(), "−3.5".to_owned()], vec!["DQN <b>".to_owned()]],
    };
    let about = About::new("a \"title\" <script>", "what & why");
    let figure =
        |caption: &str| Figure::new(CurveChart { about: about.clone(), ..CurveChart::default() }.draw(), caption);
    let with_file = Figure { files: vec![("CSV".to_owned(), "a\"b.csv".to_owned())], ..figure("Second.") };
    Page {
        title: "Report <1>".to_owned(),
        introduction: vec![
            Block::from("Five seeds & no more."),
            Block::Warning(Text(vec![Span::Code("dqn/3".to_owned()), Span::Strong(" is missing".to_owned())])),
            Block::List(vec![Text::from("one"), Text::from("two")]),
        ],
        sections: vec![
            Section::new("Returns", vec![Block::Table(table), Block::Figure(figure("First."))]),
            Section::new("§ 2: Größe", Vec::new()),
            Section::new("Returns", vec![Block::Figure(with_file)]),
        ],
    }
}

fn select<'a>(document: &'a Html, selector: &str) -> Vec<ElementRef<'a>> {
    document.select(&Selector::parse(selector).unwrap()).collect()
}

fn text(element: &ElementRef) -> String {
    element.text().collect()
}

#[test]
fn parses_without_errors() {
    let document = Html::parse_document(&page().to_html());
    assert!(document.errors.is_empty(), "{:?}", document.errors);
    assert_eq!(select(&document, "html")[0].attr("lang"), Some("en"));
    assert_eq!(select(&document, "script, link, img, iframe").len(), 0, "nothing is loaded or run");
}

#[test]
fn loads_nothing_from_elsewhere() {
    let html = page().to_html();
    assert!(!html.replace("http://www.w3.org/2000/svg", "").contains("http"));
    assert!(html.matches("url(").count() == 1 && html.contains("url(data:font/ttf;base64,"));
}

#[test]
fn texts_are_escaped() {
    let document = Html::parse_document(&page().to_html());
    assert_eq!(text(&select(&document, "h1")[0]), "Report <1>");
    assert_eq!(text(&select(&document, "caption")[0]), "Returns & steps");
    assert_eq!(text(&select(&document, "tbody th")[1]), "DQN <b>");
    assert_eq!(text(&select(&document, "svg title")[0]), "a \"title\" <script>");
    assert_eq!(select(&document, "figcaption a")[0].attr("href"), Some("a\"b.csv"));
}

#[test]
fn contents_lead_to_every_section() {
    let document = Html::parse_document(&page().to_html());
    let links: Vec<_> =
        select(&document, "nav a").iter().map(|link| link.attr("href").unwrap()[1..].to_owned()).collect();
    let ids: Vec<_> =
        select(&document, "section").iter().map(|section| section.attr("id").unwrap().to_owned()).collect();
    assert_eq!(links, ids);
    assert_eq!(links, ["returns", "2-größe", "returns-2"]);
    assert_eq!(text(&select(&document, "section#returns-2 h2")[0]), "Returns");
}

#[test]
fn figures_are_numbered_and_described() {
    let document = Html::parse_document(&page().to_html());
    let captions: Vec<_> = select(&document, "figcaption").iter().map(text).collect();
    assert_eq!(captions, ["Figure 1. First.", "Figure 2. Second. CSV"]);
    assert_eq!(select(&document, "svg[role=img] > title").len(), 2);
    assert_eq!(select(&document, "svg[role=img] > desc").len(), 2);
}

#[test]
fn tables_have_scoped_headers_and_whole_rows() {
    let document = Html::parse_document(&page().to_html());
    assert!(select(&document, "thead th").iter().all(|header| header.attr("scope") == Some("col")));
    assert!(select(&document, "tbody th").iter().all(|header| header.attr("scope") == Some("row")));
    assert!(select(&document, "tbody tr").iter().all(|row| row.child_elements().count() == 2));
    assert_eq!(select(&document, "td.numeric").len(), 2);
}

#[test]
fn is_the_same_every_time() {
    assert_eq!(page().to_html(), page().to_html());
}
