#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace slide {

/// Manual page, section 1, of a program, in the man(7) macros, from the description that also makes --help:
/// options group by group with their defaults, the subcommands one by one, then the footer. In the footer a paragraph
/// "Heading:" with indented lines becomes a section of verbatim lines, and "Heading: text" a section of text.
/// @param name  of the program
/// @param version  e.g. "SLIDE 0.1.0", for the page's foot
[[nodiscard]] std::string man_page(const CLI::App& app, const std::string& name, const std::string& version);

/// Completion script for bash. Completes subcommands, names of options, and their values
/// as the type's name tells: {a,b} and lower-case alternatives (FILE|auto|none) are words, FILE is a file,
/// DIR a folder. Positional arguments are files.
[[nodiscard]] std::string bash_completion(const CLI::App& app, const std::string& name);

/// Adds what every program of the project has: --version, and --man and --completion, which print the two above.
/// Each ends parse() with success, as --help does, whatever else is required.
void add_help_options(CLI::App& app, const std::string& name);

}  // namespace slide
