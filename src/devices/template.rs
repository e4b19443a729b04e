//! `sunglint devices template`: files of SCPI devices, to begin with.

use crate::output::{Console, Usage};
use clap::Args;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_drivers::scpi::{TEMPLATES, Template};

/// Arguments of `sunglint devices template`.
#[derive(Debug, Args)]
pub struct TemplateArgs {
    /// The template; without one, all are listed
    pub name: Option<String>,
}

fn title(template: &'static Template) -> &'static str {
    template.text.lines().next().map_or("", |line| line.trim_start_matches(['#', ' ']))
}

#[derive(Serialize)]
struct TemplateJson {
    name: &'static str,
    title: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    text: Option<&'static str>,
}

impl TemplateJson {
    fn new(template: &'static Template, text: Option<&'static str>) -> Self {
        Self { name: template.name, title: title(template), text }
    }
}

#[derive(Serialize)]
struct TemplatesJson {
    templates: Vec<TemplateJson>,
}

pub(super) fn run(args: &TemplateArgs, console: Console) -> anyhow::Result<()> {
    let Some(name) = &args.name else {
        let mut text = String::new();
        for template in &TEMPLATES {
            let _ = writeln!(text, "{:<16} {}", template.name, title(template));
        }
        text.push_str(
            "\nnone was tried with an instrument; sunglint devices template NAME > device.toml",
        );
        let templates = TEMPLATES.iter().map(|t| TemplateJson::new(t, None)).collect();
        return console.result(&text, &TemplatesJson { templates });
    };
    let Some(template) = Template::named(name) else {
        let known: Vec<&str> = TEMPLATES.iter().map(|template| template.name).collect();
        let known = known.join(", ");
        return Err(Usage(format!("template: found `{name}`, expected one of {known}")).into());
    };
    console.result(template.text.trim_end(), &TemplateJson::new(template, Some(template.text)))
}
