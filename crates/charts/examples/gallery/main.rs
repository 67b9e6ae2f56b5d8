//! Draws every kind of chart from synthetic data, as SVG, as PNG and in one page.
//!
//! ```text
//! cargo run -p charts --example gallery OUT
//! ```

mod figures;

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

use charts::html::{Block, Column, Figure, Page, Section, Span, Table, Text};
use figures::Example;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::args_os().nth(1).ok_or("usage: gallery OUT")?);
    fs::create_dir_all(&out)?;
    let examples = figures::all();
    for Example { name, drawing, .. } in &examples {
        fs::write(out.join(name).with_extension("svg"), drawing.to_svg())?;
        fs::write(out.join(name).with_extension("png"), drawing.to_png(2.0)?)?;
    }
    fs::write(out.join("gallery.html"), page(examples).to_html())?;
    Ok(())
}

fn page(examples: Vec<Example>) -> Page {
    let figure = |example: Example| {
        let link = |extension: &str| (extension.to_uppercase(), format!("{}.{extension}", example.name));
        let files = vec![link("svg"), link("png")];
        Block::Figure(Figure { files, ..Figure::new(example.drawing, example.caption) })
    };
    let mut figures: Vec<Block> = Vec::new();
    let mut edges: Vec<Block> = Vec::new();
    for example in examples {
        let list = if example.edge { &mut edges } else { &mut figures };
        list.push(figure(example));
    }
    let link = Span::Link { text: "the cases at the edge".to_owned(), href: "#edge-cases".to_owned() };
    Page {
        title: "Gallery of charts".to_owned(),
        introduction: vec![
            Block::Paragraph(Text(vec![Span::Plain("All numbers are made up. See also ".to_owned()), link])),
            Block::Warning(Text::from("3 of 40 runs are unfinished: dqn seed 4, 7 and 9.")),
        ],
        sections: vec![
            Section::new("Tables", vec![Block::Table(table())]),
            Section::new("Figures", figures),
            Section::new("Edge cases", edges),
        ],
    }
}

fn table() -> Table {
    let mut columns = vec![Column::text("arm")];
    columns.extend((0..5).map(|level| Column::numeric(format!("level {level}"))));
    let rows = figures::ARMS.iter().enumerate().map(|(arm, name)| {
        let cells = (0..5).map(|level| charts::number(45.0 - 17.3 * (arm * level) as f64, 1) + " ± 3.1");
        std::iter::once((*name).to_owned()).chain(cells).collect()
    });
    Table {
        caption: Text::from("Final return, mean ± standard deviation over 10 seeds."),
        columns,
        rows: rows.collect(),
    }
}
