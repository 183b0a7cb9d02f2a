// slide_convert: PyTorch checkpoints and safetensors files to safetensors files, and a look into both.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "examples/cli_docs.h"
#include "graphs/calibrate.h"
#include "graphs/catalogue.h"
#include "render/image_file.h"
#include "render/photo_layers.h"
#include "runtime/atomic_file.h"
#include "runtime/error.h"
#include "runtime/program.h"
#include "weights_tools/convert.h"
#include "weights_tools/prefix.h"
#include "weights_tools/transformers_names.h"

namespace {

struct Arguments {
  std::string file;
  std::string output;
  std::string key;
  std::string dtype = "f32";
  bool list = false;
  bool verify = false;
  bool overwrite = false;
  std::string model;
  std::vector<std::string> photos;
};

/// Says on standard error how far calibration is: a line that is rewritten on a terminal, else one for every
/// tenth.
bool show_progress(const slide::Progress& progress) {
  const bool terminal = ::isatty(STDERR_FILENO) != 0;
  const int tenth = 10 * progress.done / std::max(1, progress.total);
  const bool fresh = progress.done == 0 || tenth != 10 * (progress.done - 1) / std::max(1, progress.total);
  const bool last = progress.done + 1 == progress.total;
  if (terminal || fresh)
    std::fprintf(stderr, "%sslide_convert: calibrating, run %d of %d%s", terminal ? "\r" : "",
                 progress.done + 1, progress.total, terminal && !last ? "" : "\n");
  return true;
}

void run(const Arguments& arguments) {
  using namespace slide;
  std::unique_ptr<WeightReader> reader = open_weights(arguments.file, arguments.key);
  if (arguments.model != "any" && has_transformers_names(*reader)) {
    std::fprintf(stderr,
                 "slide_convert: %s: named as by the transformers library; the names written are those of "
                 "its authors\n",
                 arguments.file.c_str());
    reader = with_authors_names(std::move(reader));
  }
  if (arguments.model != "any")
    if (const std::string prefix = needless_prefix(*reader, arguments.model); !prefix.empty()) {
      std::fprintf(stderr, "slide_convert: %s: all names begin with \"%s\"; the tensors fit without it\n",
                   arguments.file.c_str(), prefix.c_str());
      reader = without_prefix(std::move(reader), prefix);
    }
  if (arguments.list) std::fputs(listing(*reader).c_str(), stdout);
  if (arguments.verify) std::puts(verify(*reader).c_str());
  if (arguments.output.empty()) return;
  if (!arguments.photos.empty() && arguments.model == "any")
    throw Error(ErrorKind::kUsage, "weights of any model cannot be calibrated", "give --model");
  std::vector<Tensor> photos;  // read before anything is written
  for (const std::string& photo : arguments.photos)
    photos.push_back(tensor_from_image(read_photo(photo).colour));
  const std::map<std::string, DType> types = {
      {"f32", DType::kF32}, {"f16", DType::kF16}, {"bf16", DType::kBF16}};
  ConvertOptions options{.model = arguments.model,
                         .dtype = types.at(arguments.dtype),
                         .calibrate = {},
                         .overwrite = arguments.overwrite};
  if (!photos.empty())
    options.calibrate = [&](const std::string& model, const WeightSource& weights) {
      return graphs::calibrate(model, weights, photos, 0, show_progress);
    };
  const ConvertReport report = convert(*reader, arguments.output, options);
  for (const std::string& warning : report.warnings)
    std::fprintf(stderr, "slide_convert: warning: %s\n", warning.c_str());
  std::printf("%s: %s, %zu tensors, %llu bytes of data\n", arguments.output.c_str(),
              report.model == "any" ? "any model" : report.model.c_str(), report.tensors,
              static_cast<unsigned long long>(report.bytes));
  if (!photos.empty())
    std::printf("%s: %zu layers calibrated with %zu photos\n", arguments.output.c_str(), report.calibrated,
                photos.size());
}

std::string model_names() {
  std::string names;
  for (const slide::graphs::Model& model : slide::graphs::catalogue()) names.append(model.name).append(", ");
  return names + "or any";
}

int parse_and_run(int argc, char** argv) {
  CLI::App app(
      "Converts PyTorch checkpoints (.pt, .pth) and safetensors files to safetensors, and shows what they "
      "hold.");
  Arguments arguments;
  app.add_option("FILE", arguments.file, "checkpoint or safetensors file")->required()->type_name("FILE");
  app.add_option("-o,--output", arguments.output, "safetensors file to write")->type_name("FILE");
  app.add_option("--model", arguments.model,
                 "what the tensors must fit: " + model_names() + "; default: whichever fits");
  app.add_option("--dtype", arguments.dtype, "of the result's floating-point tensors")
      ->check(CLI::IsMember({"f32", "f16", "bf16"}))
      ->capture_default_str();
  app.add_option(
         "--calibrate", arguments.photos,
         "photos to find the ranges of 8-bit layers with; they are stored in the result (end the list "
         "with -- or another option before FILE)")
      ->type_name("PHOTO...");
  app.add_option("--key", arguments.key,
                 "which set of tensors of a checkpoint that holds several, such as state_dict");
  app.add_flag("--list", arguments.list, "print a table of names, dtypes, shapes and bytes");
  app.add_flag("--overwrite", arguments.overwrite,
               "replace an existing file that slide_convert has not made, too; FILE is never replaced");
  app.add_flag("--verify", arguments.verify, "read everything: checksums must match, values be finite");
  slide::add_help_options(app, "slide_convert");
  try {
    app.parse(argc, argv);
    if (!arguments.list && !arguments.verify && arguments.output.empty())
      throw CLI::RequiredError("one of --output, --list and --verify");
    if (!arguments.photos.empty() && arguments.output.empty())
      throw CLI::RequiredError("--calibrate needs --output, which");
    for (const char* option : {"--overwrite", "--dtype"})
      if (app.count(option) > 0 && arguments.output.empty())
        throw CLI::RequiredError(std::string(option) + " needs --output, which");
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : slide::exit_code(slide::ErrorKind::kUsage);
  }
  run(arguments);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return slide::run_program("slide_convert", [&] { return parse_and_run(argc, argv); });
}
