#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "examples/slide_run/options.h"

namespace slide::run {

/// Folders replaced by the photos in them, sorted by name. What cannot be looked at (a link that leads
/// nowhere or in circles, a folder that may not be read) stays in the list under its name, so that it fails
/// as one photo among others.
[[nodiscard]] std::vector<std::string> find_photos(const std::vector<std::string>& inputs);

/// What is asked before any work: options that contradict each other or would do nothing; outputs that would
/// replace an input, another output, or a file that this program has not made.
/// @param app  the parser that has filled `options`: tells which of them were given
/// @throws Error(kUsage)
void check_call(const CLI::App& app, const Options& options, const std::vector<std::string>& photos);

}  // namespace slide::run
