//! Where a node was written: what PyTorch's exporters leave in a graph about the Python program.
//!
//! | exporter | left in | order of frames |
//! |---|---|---|
//! | dynamo | the node's properties `pkg.torch.onnx.stack_trace`, `…name_scopes`, `…class_hierarchy` | innermost last |
//! | TorchScript, `verbose=True` | the node's `doc_string`, `FILE(LINE): FUNCTION` a line | innermost first |
//! | TorchScript | the node's name alone: `/stack.0/c/Conv` | |
//!
//! A user wants his own line, not PyTorch's: `y = self.conv(x)`, not `return self._conv_forward(…)`. So the frame chosen is
//! the innermost that does not lie in the package `torch`, and the innermost of all where every one does.

use super::report::Source;
use crate::onnx::message::NodeProto;

const STACK_TRACE: &str = "pkg.torch.onnx.stack_trace";
const NAME_SCOPES: &str = "pkg.torch.onnx.name_scopes";
const CLASS_HIERARCHY: &str = "pkg.torch.onnx.class_hierarchy";

/// Where the exporter says that a node comes from; `None` where it says nothing.
///
/// What is not known is left empty: the module's path in graphs of other programs, the line (0) and file where only a
/// module is known, the code in graphs of the TorchScript exporter.
pub fn source(node: &NodeProto) -> Option<Source> {
    let property = |key: &str| {
        let entry = node.metadata_props.iter().find(|entry| entry.key.as_deref() == Some(key));
        entry.and_then(|entry| entry.value.as_deref())
    };
    let module = match property(NAME_SCOPES) {
        Some(scopes) => module(scopes, property(CLASS_HIERARCHY)),
        None => module_of_name(node.name.as_deref().unwrap_or_default()),
    };
    let frames = match (property(STACK_TRACE), node.doc_string.as_deref()) {
        (Some(trace), _) => frames_of_trace(trace),
        (None, Some(text)) => frames_of_doc_string(text),
        (None, None) => Vec::new(),
    };
    let users = frames.iter().find(|frame| !is_torch(frame.file)).or(frames.first());
    let (file, line, code) = users.map_or(("", 0, ""), |frame| (frame.file, frame.line, frame.code));
    (!file.is_empty() || !module.is_empty()).then(|| Source {
        file: file.to_owned(),
        line,
        code: code.to_owned(),
        module,
    })
}

/// One line of a Python stack.
struct Frame<'a> {
    file: &'a str,
    line: usize,
    code: &'a str,
}

/// The frames of a Python traceback, innermost first.
///
/// `File "net.py", line 7, in forward`, each followed by the line's text where Python could read the file.
fn frames_of_trace(trace: &str) -> Vec<Frame<'_>> {
    let mut frames: Vec<Frame> = Vec::new();
    for text in trace.lines().map(str::trim) {
        match traced_place(text) {
            Some((file, line)) => frames.push(Frame { file, line, code: "" }),
            // Python marks the part of a line that it means by a line of ^ and ~.
            None if text.chars().all(|c| matches!(c, '^' | '~' | ' ')) => {}
            None => {
                if let Some(frame) = frames.last_mut().filter(|frame| frame.code.is_empty()) {
                    frame.code = text;
                }
            }
        }
    }
    frames.reverse();
    frames
}

fn traced_place(text: &str) -> Option<(&str, usize)> {
    let (file, rest) = text.strip_prefix("File \"")?.split_once("\", line ")?;
    let digits = rest.split(',').next()?;
    Some((file, digits.trim().parse().ok()?))
}

/// The frames of TorchScript's text, `/home/me/net.py(7): forward` a line, innermost first as they stand.
fn frames_of_doc_string(text: &str) -> Vec<Frame<'_>> {
    let place = |text: &'_ str| -> Option<(usize, usize, usize)> {
        let open = text.find("): ").and_then(|close| text[..close].rfind('('))?;
        let line = text[open + 1..].split(')').next()?.parse().ok()?;
        Some((0, open, line))
    };
    text.lines()
        .map(str::trim)
        .filter_map(|text| {
            place(text).map(|(from, to, line)| Frame { file: &text[from..to], line, code: "" })
        })
        .collect()
}

/// Whether a file is PyTorch's own: `…/torch/nn/modules/conv.py`, but not `/home/me/torch/net.py`.
fn is_torch(file: &str) -> bool {
    let parts: Vec<&str> = file.split(['/', '\\']).collect();
    let own = |after: &str| {
        after.starts_with('_')
            || matches!(
                after,
                "nn" | "jit" | "onnx" | "fx" | "export" | "utils" | "autograd" | "functional.py"
            )
    };
    file.starts_with("<frozen")
        || parts.windows(2).any(|pair| {
            (pair[1] == "torch" && matches!(pair[0], "site-packages" | "dist-packages"))
                || (pair[0] == "torch" && own(pair[1]))
        })
}

/// The module's path with its class: `stack.0.c (torch.nn.modules.conv.Conv2d)`.
///
/// Both lists are Python's text of a list, outermost first, and end with the operator itself: the last but one is the
/// module. The outermost module has no name.
fn module(scopes: &str, classes: Option<&str>) -> String {
    let scopes = python_list(scopes);
    let Some(last) = scopes.len().checked_sub(2) else { return String::new() };
    let class = classes.map(python_list).and_then(|classes| classes.get(last).cloned());
    match (scopes[last].as_str(), class) {
        ("", None) => String::new(),
        (path, None) => path.to_owned(),
        ("", Some(class)) => class,
        (path, Some(class)) => format!("{path} ({class})"),
    }
}

/// The texts of a Python list of texts: `['', 'a', "b's"]`.
fn python_list(text: &str) -> Vec<String> {
    let mut texts = Vec::new();
    let mut characters = text.chars();
    while let Some(quote) = characters.find(|c| matches!(c, '\'' | '"')) {
        let mut item = String::new();
        while let Some(c) = characters.next() {
            match c {
                '\\' => item.extend(characters.next()),
                c if c == quote => break,
                c => item.push(c),
            }
        }
        texts.push(item);
    }
    texts
}

/// `stack.0.seq.0` of `/stack.0/seq/seq.0/Conv`: TorchScript's scopes, each of which repeats its parent's last name.
fn module_of_name(name: &str) -> String {
    let Some(scopes) = name.strip_prefix('/') else { return String::new() };
    let mut parts: Vec<&str> = scopes.split('/').collect();
    // The operator itself.
    parts.pop();
    let mut path: Vec<&str> = Vec::new();
    for part in parts {
        // `seq/seq.0` is the child 0 of seq.
        if let Some(parent) = path.last().copied()
            && part.strip_prefix(parent).is_some_and(|rest| rest.starts_with('.'))
        {
            path.pop();
        }
        path.push(part);
    }
    path.join(".")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::message::StringStringEntryProto;

    fn exported(properties: &[(&str, &str)]) -> NodeProto {
        let entry = |&(key, value): &(&str, &str)| StringStringEntryProto {
            key: Some(key.into()),
            value: Some(value.into()),
        };
        NodeProto { metadata_props: properties.iter().map(entry).collect(), ..Default::default() }
    }

    /// As torch 2.15 writes it.
    const TRACE: &str = "File \"/home/me/net.py\", line 11, in forward\n    return self.stack[0](x) + 1.0\n  \
        File \"/home/me/net.py\", line 7, in forward\n    y = self.n(self.c(x))\n               ^^^^^^^^^\n  \
        File \"/venv/lib/python3.11/site-packages/torch/nn/modules/conv.py\", line 565, in forward\n    \
        return self._conv_forward(input, self.weight, self.bias)";

    #[test]
    fn the_innermost_frame_outside_torch_is_the_users() {
        let node = exported(&[
            (STACK_TRACE, TRACE),
            (NAME_SCOPES, "['', 'stack.0', 'stack.0.c', 'conv2d']"),
            (CLASS_HIERARCHY, "['net.N', 'net.B', 'torch.nn.modules.conv.Conv2d', 'aten.conv2d.default']"),
        ]);
        let found = source(&node).expect("a source");
        assert_eq!(
            (found.file.as_str(), found.line),
            ("/home/me/net.py", 7),
            "not torch's 565, not the caller's 11"
        );
        assert_eq!(found.code, "y = self.n(self.c(x))", "its text");
        assert_eq!(found.module, "stack.0.c (torch.nn.modules.conv.Conv2d)", "its module");
    }

    #[test]
    fn where_every_frame_is_torchs_the_innermost_stands() {
        let trace =
            "File \"/x/site-packages/torch/nn/functional.py\", line 3, in relu\n    return torch.relu(x)";
        let found = source(&exported(&[(STACK_TRACE, trace)])).expect("a source");
        assert_eq!((found.line, found.code.as_str()), (3, "return torch.relu(x)"), "better than none");
    }

    #[test]
    fn a_doc_string_of_torchscript_is_read_from_the_inside() {
        let node = NodeProto {
            name: Some("/stack.0/seq/seq.0/Conv".into()),
            doc_string: Some(
                "/venv/lib/python3.11/site-packages/torch/nn/modules/conv.py(560): _conv_forward\n\
                 /home/me (old)/net.py(7): forward\n/home/me (old)/net.py(11): forward\n"
                    .into(),
            ),
            ..Default::default()
        };
        let found = source(&node).expect("a source");
        assert_eq!((found.file.as_str(), found.line), ("/home/me (old)/net.py", 7), "brackets in a path");
        assert_eq!((found.code.as_str(), found.module.as_str()), ("", "stack.0.seq.0"), "module by the name");
    }

    #[test]
    fn a_folder_of_the_users_may_be_called_torch() {
        assert!(!is_torch("/home/me/torch/net.py"), "his own");
        assert!(!is_torch("/venv/site-packages/torchvision/models/resnet.py"), "another package");
        assert!(is_torch("C:\\venv\\site-packages\\torch\\nn\\modules\\conv.py"), "torch on Windows");
        assert!(is_torch("/src/pytorch/torch/_dynamo/eval.py"), "torch built from source");
    }

    #[test]
    fn texts_that_are_no_traces_say_nothing_and_stop_nothing() {
        assert_eq!(source(&NodeProto::default()), None, "nothing");
        for text in ["", "(", "): ", "a(b): c", "File \"", "File \"x\", line many, in f", "\\", "'", "['"] {
            let node = NodeProto { doc_string: Some(text.into()), ..exported(&[(NAME_SCOPES, text)]) };
            assert_eq!(source(&node), None, "{text:?}");
            assert_eq!(source(&exported(&[(STACK_TRACE, text)])), None, "{text:?}");
        }
        assert_eq!(python_list(r#"['it\'s', "a'b"]"#), ["it's", "a'b"], "quotes");
    }
}
