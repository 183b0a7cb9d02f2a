// slide_check: the definitions and kernels of this build against expected numbers. See docs/slide_check.md.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "examples/cli_docs.h"
#include "examples/operator_library.h"
#include "graphs/catalogue.h"
#include "graphs/compare_report.h"
#include "graphs/formula_weights.h"
#include "graphs/golden_check.h"
#include "graphs/photo_inputs.h"
#include "ops/check_report.h"
#include "ops/generate/generate.h"
#include "ops/judge.h"
#include "ops/npy.h"
#include "render/image_file.h"
#include "render/photo_layers.h"
#include "runtime/cpu.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/program.h"
#include "runtime/safetensors.h"
#include "runtime/threads.h"

namespace {

using namespace slide;

struct Arguments {
  std::string isa;
  int threads = 0;
  bool json = false;
  std::vector<std::string> cases;
  std::string model, weights, golden, image, dump;
  bool formula_weights = false;
  bool fused = false;
  std::string precision;
  std::optional<double> error_budget;
  std::string actual, library, unit = "fp32";
  std::optional<double> factor;
  std::int64_t size = 0;
  int rows = 0;
  std::string op, folder;
  std::uint64_t seed = 1;
  int count = 16;
  bool overwrite = false;
};

graphs::Golden open_golden(const std::string& path) {
  try {
    return graphs::Golden::open(path);
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadWeights) throw;
    throw Error(ErrorKind::kBadInput, e.what());  // the weights of this run are not at fault
  }
}

int check_operators(const Arguments& a) {
  const std::vector<ops::CheckedFile> files = ops::check_files(a.cases, active_isa());
  for (const ops::CheckedFile& file : files)
    if (!file.check) std::cerr << "slide_check: " << file.error << "\n";
  std::cout << (a.json ? ops::json_of(files) : ops::table_of(files));
  return ops::exit_code(files);
}

Tensor read_actual(const Arguments& a) {
  const std::string& path = a.actual.empty() ? a.cases.front() : a.actual;
  if (path.ends_with(".npy")) return ops::read_npy(path);
  if (a.actual.empty() && !path.ends_with(".safetensors"))
    throw Error(ErrorKind::kUsage, path + ": such a test holds no result to judge", "give it with --actual");
  const std::optional<Tensor> tensor = ops::tensor_in(path, "actual");
  if (!tensor)
    throw Error(ErrorKind::kBadInput, path + ": there is no tensor \"actual\"",
                "give the result to judge with --actual");
  return *tensor;
}

ops::Unit unit_of(const Arguments& a) {
  const std::optional<ops::Unit> unit = ops::unit_from_name(a.unit);
  if (!unit) throw Error(ErrorKind::kUsage, "there is no unit named " + a.unit);
  return *unit;
}

/// How many of the cases that a library was asked for came to what.
struct Verdicts {
  int right = 0, wrong = 0;
  std::vector<std::string> errors;
  ErrorKind first_error = ErrorKind::kBadInput;
};

/// Judges one case, and shows it if it is wrong.
void judge_case(const Arguments& a, const std::string& file, Verdicts& verdicts) {
  try {
    const ops::OperatorCase c = ops::read_case(file);
    const ops::Judgement judgement = ops::judge(c, result_of_library(a.library, c), unit_of(a), a.factor);
    ++(judgement.passed() ? verdicts.right : verdicts.wrong);
    if (!judgement.passed())
      std::cout << file << "\n" << c.op << " in " << a.unit << ": " << ops::text_of(judgement) << "\n";
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadInput) throw;
    if (verdicts.errors.empty()) verdicts.first_error = e.kind();
    verdicts.errors.emplace_back(e.what());
  }
}

/// A library on many cases: those that are wrong one by one, then how many there are.
int judge_library(const Arguments& a, const std::vector<std::string>& files) {
  Verdicts verdicts;
  for (const std::string& file : files) judge_case(a, file, verdicts);
  for (const std::string& error : verdicts.errors) std::cerr << "slide_check: " << error << "\n";
  std::cout << files.size() << " cases: " << verdicts.right << " right, " << verdicts.wrong << " wrong";
  if (!verdicts.errors.empty()) std::cout << ", " << verdicts.errors.size() << " without a result";
  std::cout << "\n";
  if (verdicts.right + verdicts.wrong == 0) return exit_code(verdicts.first_error);
  return verdicts.wrong == 0 && verdicts.errors.empty() ? 0 : 1;
}

int judge_result(const Arguments& a) {
  if (!a.library.empty()) {
    std::vector<std::string> files;
    for (const std::string& path : a.cases)
      for (std::string& file : ops::case_files(path)) files.push_back(std::move(file));
    if (files.size() > 1) return judge_library(a, files);
  } else if (a.cases.size() > 1) {
    throw Error(ErrorKind::kUsage, "one result cannot be that of several cases",
                "give one CASE, or --library");
  }
  const ops::OperatorCase operator_case = ops::read_case(a.cases.front());
  const Tensor actual = a.library.empty() ? read_actual(a) : result_of_library(a.library, operator_case);
  const ops::Judgement judgement = ops::judge(operator_case, actual, unit_of(a), a.factor);
  std::cout << operator_case.op << " in " << a.unit << ": " << ops::text_of(judgement);
  return judgement.passed() ? 0 : 1;
}

int generate_cases(const Arguments& a) {
  const std::size_t count = ops::generate_files(a.op, a.seed, a.count, a.folder, a.overwrite);
  std::cout << count << " operator cases written to " << a.folder << "\n";
  return 0;
}

/// What --fused, --precision and --error-budget ask for.
graphs::CompareOptions compare_options(const Arguments& a) {
  const PrecisionChoice choice = precision_choice(a.precision, a.error_budget);
  return {.dump_folder = a.dump,
          .overwrite = a.overwrite,
          .source = a.model,
          .fused = a.fused || !a.precision.empty() || a.error_budget,
          .precision = choice.precision,
          .error_budget = choice.error_budget};
}

int check_network(const Arguments& a) {
  (void)graphs::find_model(a.model);
  const graphs::Golden golden = open_golden(a.golden);
  if (golden.network() != a.model)
    throw Error(ErrorKind::kUsage,
                a.golden + " is a golden run of " + golden.network() + ", not of " + a.model);
  std::unique_ptr<WeightSource> weights;
  if (a.formula_weights)
    weights = std::make_unique<graphs::FormulaWeights>(golden.weights());
  else
    weights = std::make_unique<SafetensorsWeights>(a.weights);
  const graphs::GoldenCheck check = graphs::check_golden(golden, *weights, compare_options(a));
  std::cout << (a.json ? graphs::json_of(check) : graphs::table_of(check));
  return check.passed() ? 0 : 1;
}

int compare_network(const Arguments& a) {
  (void)graphs::find_model(a.model);
  std::unique_ptr<WeightSource> weights;
  if (a.formula_weights)
    weights = std::make_unique<graphs::FormulaWeights>(graphs::FormulaWeights::made_up());
  else
    weights = std::make_unique<SafetensorsWeights>(a.weights);
  const graphs::PhotoRun run =
      graphs::photo_run(a.model, tensor_from_image(read_photo(a.image).colour), *weights, a.size);
  const graphs::Comparison comparison = graphs::compare(*run.graph, *weights, run.inputs, compare_options(a));
  std::cout << (a.json ? graphs::json_of(a.model, comparison) : graphs::table_of(comparison, a.rows));
  return comparison.passed() ? 0 : 1;
}

void add_common(CLI::App& command, Arguments& a) {
  command.add_flag("--json", a.json, "print a JSON object instead of a table");
  command.add_option(
      "--isa", a.isa,
      "kernels up to this level: baseline, avx2, avxvnni, avx512, avx512vnni, avx512bf16, amx, "
      "neon, neondot, neoni8mm, neonbf16; or of one without some features: avx512bf16,-avx512_vnni");
  command.add_option("--threads", a.threads, "number of threads; 0: one a core")->check(CLI::Range(0, 1024));
}

void add_model(CLI::App& command, Arguments& a) {
  std::string names;
  for (const graphs::Model& m : graphs::catalogue())
    names += (names.empty() ? "" : ", ") + std::string(m.name);
  command.add_option("MODEL", a.model, "one of " + names)->required();
  CLI::Option_group* weights = command.add_option_group("weights");
  weights->add_option("--weights", a.weights, "weight file (safetensors)");
  weights->add_flag("--formula-weights", a.formula_weights,
                    "weights that are a formula: the golden file's own, or made-up ones");
  weights->require_option(1);
  command.add_flag("--fused", a.fused, "compare the outputs of the fused plan, that of real runs, too");
  command.add_option("--precision", a.precision,
                     "the fused plan's, its outputs beside the error it predicts: fp32, bf16, int8, auto");
  command.add_option("--error-budget", a.error_budget,
                     "the fused plan's: fastest kernels with this predicted error, 1e-7 to 1");
  CLI::Option* const dump = command.add_option(
      "--dump", a.dump, "write every node's inputs and expected output as operator cases here");
  command.add_flag("--overwrite", a.overwrite, "replace existing files that --dump has not written, too")
      ->needs(dump);
}

int run(CLI::App& app, int argc, char** argv) {
  Arguments a;
  CLI::App* op = app.add_subcommand("op", "check operators and their kernels on case files");
  op->add_option(
        "CASE", a.cases,
        "case files (.safetensors), ONNX node tests (model.onnx), WebNN tests (OPERATOR.json, one of "
        "them OPERATOR.json#3), or folders of them")
      ->required();
  CLI::App* judge = app.add_subcommand("judge", "judge somebody else's result of a case, element by element");
  judge
      ->add_option(
          "CASE", a.cases,
          "case file (.safetensors), an ONNX node test (model.onnx) or a WebNN test (OPERATOR.json#3); "
          "with --library also several of them, or folders")
      ->required();
  judge->add_option("--actual", a.actual,
                    "the result: .npy, or safetensors with one tensor or one named actual; default: the "
                    "tensor actual in CASE");
  judge
      ->add_option(
          "--library", a.library,
          "a shared library whose function slide_operator (examples/c_api/slide_operator.h) computes "
          "the result from the case's inputs, in this process")
      ->excludes("--actual");
  judge->add_option("--unit", a.unit, "what it was multiplied in: fp32, tf32, bf16, fp16, int8")
      ->check(CLI::IsMember({"fp32", "tf32", "bf16", "fp16", "int8"}))
      ->capture_default_str();
  judge->add_option("--factor", a.factor, "errors up to this times unit roundoff times the operator's scale")
      ->check(CLI::Range(1e-3, 1e9));
  CLI::App* generate = app.add_subcommand("generate", "write operator cases that kernels may be wrong on");
  generate->add_option("OP", a.op, "an operator of docs/operators.md, or all")->required();
  generate->add_option("--seed", a.seed, "which cases: the same seed gives the same ones")
      ->capture_default_str();
  generate->add_option("--count", a.count, "cases of an operator; they go through 8 kinds of trials in turn")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  generate->add_option("-o,--output", a.folder, "folder to write them to, made if need be")->required();
  generate->add_flag("--overwrite", a.overwrite, "replace existing files that slide_check has not made, too");
  CLI::App* net = app.add_subcommand("net", "check a network on a golden run");
  add_model(*net, a);
  net->add_option("--golden", a.golden, "golden file (safetensors)")->required();
  CLI::App* compare = app.add_subcommand("compare", "fast against float64 on a photo, node by node");
  add_model(*compare, a);
  compare->add_option("--image", a.image, "the photo")->required();
  compare->add_option("--size", a.size, "longer side to work at; the model's own by default");
  CLI::Option* const rows =
      compare->add_option("--rows", a.rows, "lines to print; all by default, what failed always");
  for (CLI::App* command : {op, net, compare}) add_common(*command, a);
  rows->excludes("--json");
  add_help_options(app, "slide_check");
  app.require_subcommand(1);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  if (!a.isa.empty()) {
    set_isa(isa_from_text(a.isa, "--isa"));
  }
  set_thread_count(a.threads);
  if (op->parsed()) return check_operators(a);
  if (judge->parsed()) return judge_result(a);
  if (generate->parsed()) return generate_cases(a);
  return net->parsed() ? check_network(a) : compare_network(a);
}

}  // namespace

int main(int argc, char** argv) {
  return run_program("slide_check", [&] {
    CLI::App app(
        "Checks operators and networks of this build: float64 definitions against expected numbers, kernels "
        "against the definitions, in units of their stated bounds.");
    app.footer(
        "Exit codes: 0 all within bounds, 1 something is not, 2 usage, 3 bad input file, 4 bad weights, 5 "
        "out "
        "of memory, 6 internal, 7 the report could not be written.");
    return run(app, argc, argv);
  });
}
