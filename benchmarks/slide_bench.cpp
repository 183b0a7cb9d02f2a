// slide_bench: one network of this build, timed and measured against float64. Alone it prints a report; with
// --serve it obeys the line protocol of benchmarks/peers/README.md, so that a driver can let it and other
// runtimes take turns.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "graphs/catalogue.h"
#include "graphs/compare.h"
#include "graphs/formula_weights.h"
#include "graphs/layering.h"
#include "ops/fusion/fusion.h"
#include "runtime/cpu.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"
#include "runtime/safetensors_writer.h"
#include "runtime/threads.h"
#include "runtime/version.h"

namespace {

using namespace slide;
using nlohmann::json;

constexpr std::string_view kLayering = "layering";
constexpr int kProfiledRuns = 5;
constexpr double kLayeringParallax = 40;  // pixels: 4 % of 1008

struct Arguments {
  std::string network, size, weights = "formula", inputs, reference, isa, precision = "fp32";
  std::optional<double> error_budget;
  int threads = 0, runs = 5;
  bool json = false, serve = false, profile = false, nodes = false;
};

/// Tells the executor how to compute: the one place where flags become its options.
FastOptions fast_options(const Arguments& a) {
  FastOptions options;
  options.isa = active_isa();
  const PrecisionChoice choice = precision_choice(a.precision, a.error_budget);
  options.precision = choice.precision;
  options.error_budget = choice.error_budget;
  return options;
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// A value of /proc/self/status in KiB; 0 where there is no such file.
long status_kib(std::string_view key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(key)) return std::stol(line.substr(key.size() + 1));
  return 0;
}

std::pair<std::int64_t, std::int64_t> parse_size(const std::string& text) {
  int height = 0;
  int width = 0;
  int end = 0;
  const bool two = std::sscanf(text.c_str(), "%dx%d%n", &height, &width, &end) == 2;
  if (!two || static_cast<std::size_t>(end) != text.size())
    throw Error(ErrorKind::kUsage, "'" + text + "' is no size", "give --size HEIGHTxWIDTH");
  return {height, width};
}

std::unique_ptr<Graph> layering_graph(std::int64_t height, std::int64_t width) {
  auto g = std::make_unique<Graph>();
  const Value disparity = g->input("disparity", {1, 1, height, width});
  const graphs::LayeringMaps maps =
      graphs::soft_layering(disparity, graphs::resolve({.parallax = kLayeringParallax}));
  int index = 0;
  for (const Value& map : {maps.visibility, maps.disocclusion, maps.occlusion, maps.hole})
    g->output(std::to_string(index++), map);
  return g;
}

/// A network, its weights and inputs, ready to run.
class Bench {
 public:
  explicit Bench(const Arguments& a) {
    if (!a.inputs.empty()) case_.emplace(SafetensorsFile::open(a.inputs));
    const auto [height, width] = a.size.empty() ? size_of_case() : parse_size(a.size);
    base_kib_ = status_kib("VmHWM");
    const auto start = std::chrono::steady_clock::now();
    if (a.weights == "formula")
      weights_ = std::make_unique<graphs::FormulaWeights>(graphs::FormulaWeights::made_up());
    else
      weights_ = std::make_unique<SafetensorsWeights>(a.weights);
    graph_ =
        a.network == kLayering
            ? layering_graph(height, width)
            : graphs::build_model(a.network, {.height = height, .width = width, .weights = weights_.get()});
    graph_ = ops::fuse(*graph_);
    executor_ = std::make_unique<FastExecutor>(*graph_, *weights_, fast_options(a));
    load_ms_ = milliseconds_since(start);
    make_inputs();
  }

  double run(Profile* profile = nullptr) {
    RunOptions options;
    options.profile = profile;
    const auto start = std::chrono::steady_clock::now();
    executor_->run(inputs_, options);
    return milliseconds_since(start);
  }

  /// All outputs as float32, one after the other.
  void write_output(const std::string& path) const {
    std::ofstream file(path, std::ios::binary);
    for (const auto& [name, node] : graph_->outputs()) {
      const auto bytes = executor_->tensor(node).raw();
      file.write(static_cast<const char*>(static_cast<const void*>(bytes.data())),
                 static_cast<std::streamsize>(bytes.size()));
    }
    if (!file.flush()) throw Error(ErrorKind::kBadInput, path + ": cannot be written");
  }

  /// Max and RMS error of each output against the float64 outputs in a file, which the reference executor
  /// makes first if it is missing.
  json errors(const std::string& path) {
    if (!std::filesystem::exists(path)) make_reference(path);
    const SafetensorsFile reference = SafetensorsFile::open(path);
    json all = json::object();
    for (const auto& [name, node] : graph_->outputs()) {
      const graphs::TensorError e =
          graphs::tensor_error(executor_->tensor(node), reference.tensor("output." + name));
      all[name] = {{"max", e.max}, {"rms", e.rms}};
    }
    return all;
  }

  /// Of the definition, a multiply-accumulate being two.
  [[nodiscard]] double gflop() const {
    double macs = 0;
    for (const Node& node : graph_->nodes()) {
      if (node.kind != NodeKind::kOp) continue;
      std::vector<Shape> shapes;
      for (const int input : node.inputs) shapes.push_back(graph_->node(input).shape);
      macs += node.op->macs(shapes, node.shape);
    }
    return 2e-9 * macs;
  }

  /// What each node asks of the machine at least, as [precision, multiply-accumulates that its kernel does,
  /// bytes of its inputs, packed weights and output, kernel]: the floor under its time.
  [[nodiscard]] json work() const {
    json all = json::array();
    for (const PlanStep& step : executor_->plan().steps) {
      if (step.in_place) continue;
      const Node& node = graph_->node(step.node);
      std::vector<Shape> shapes;
      std::int64_t numbers = node.shape.count();
      for (const int input : node.inputs) {
        shapes.push_back(graph_->node(input).shape);
        if (!executor_->plan().constant[static_cast<std::size_t>(input)]) numbers += shapes.back().count();
      }
      const double bytes =
          static_cast<double>(numbers) * sizeof(float) + static_cast<double>(step.packed_bytes);
      all.push_back({name_of(step.kernel->precision()), step.kernel->macs(*node.op, shapes, node.shape),
                     bytes, step.kernel->name_and_level()});
    }
    return all;
  }

  [[nodiscard]] json facts() const {
    const Plan& plan = executor_->plan();
    return {{"gflop", gflop()},
            {"load_ms", load_ms_},
            {"base_kib", base_kib_},
            {"peak_kib", status_kib("VmHWM")},
            {"planned_bytes", plan.memory_bytes()},
            {"arena_bytes", plan.arena_bytes},
            {"weight_bytes", plan.weight_bytes},
            {"work", work()},
            {"calibrated", weights_->calibration() != nullptr},
            {"threads", thread_count()},
            {"isa", name_of(plan.isa)},
            {"version", version()}};
  }

 private:
  [[nodiscard]] std::pair<std::int64_t, std::int64_t> size_of_case() const {
    if (!case_ || case_->tensors().empty() || case_->tensors()[0].shape.rank() != 4)
      throw Error(ErrorKind::kUsage, "the size is not known", "give --size HEIGHTxWIDTH or --inputs FILE");
    const Shape& shape = case_->tensors()[0].shape;
    return {shape[2], shape[3]};
  }

  void make_inputs() {
    for (const Node& node : graph_->nodes()) {
      if (node.kind != NodeKind::kInput) continue;
      if (case_)
        inputs_[node.name] = case_->tensor("input." + node.name);
      else
        inputs_[node.name] = made_up_input(node.name, node.shape);
    }
  }

  /// Numbers in [0, 1] that vary slowly; a mask is a rectangle in the middle.
  static Tensor made_up_input(const std::string& name, const Shape& shape) {
    Tensor t(DType::kF32, shape);
    const std::int64_t height = shape[2];
    const std::int64_t width = shape[3];
    const bool mask = name == "mask" || name == "hole";
    const std::span<float> out = t.mutable_data<float>();
    for (std::int64_t i = 0; i < t.count(); ++i) {
      const double y = static_cast<double>(i / width % height) / static_cast<double>(height);
      const double x = static_cast<double>(i % width) / static_cast<double>(width);
      const bool middle = y > 0.25 && y < 0.75 && x > 0.25 && x < 0.75;
      const double noise = 0.1 * graphs::formula_unit(name, static_cast<std::uint64_t>(i) + 1);
      out[static_cast<std::size_t>(i)] =
          mask ? static_cast<float>(middle) : static_cast<float>(0.4 * (x + y * y) + 0.1 + noise);
    }
    return t;
  }

  void make_reference(const std::string& path) const {
    ReferenceExecutor reference(*graph_, *weights_);
    reference.run(inputs_);
    std::vector<std::pair<std::string, Tensor>> tensors;
    for (const auto& [name, tensor] : inputs_) tensors.emplace_back("input." + name, tensor);
    for (const auto& [name, node] : graph_->outputs())
      tensors.emplace_back("output." + name, reference.tensor(node));
    write_safetensors(path, tensors);
  }

  std::optional<SafetensorsFile> case_;
  std::unique_ptr<WeightSource> weights_;
  std::unique_ptr<Graph> graph_;
  std::unique_ptr<FastExecutor> executor_;
  NamedTensors inputs_;
  double load_ms_ = 0;
  long base_kib_ = 0;
};

void say(const json& message) { std::cout << message.dump() << std::endl; }

/// Every node with the median of its times over `runs` runs.
Profile median_profile(Bench& bench, int runs) {
  std::vector<Profile> profiles(static_cast<std::size_t>(runs));
  for (Profile& profile : profiles) bench.run(&profile);
  Profile median = profiles[0];
  for (std::size_t i = 0; i < median.size(); ++i) {
    std::vector<double> seconds;
    seconds.reserve(profiles.size());
    for (const Profile& profile : profiles) seconds.push_back(profile[i].seconds);
    std::ranges::sort(seconds);
    median[i].seconds = seconds[seconds.size() / 2];
  }
  return median;
}

/// Time by kernel, the most expensive first.
json by_kernel(const Profile& profile) {
  struct Sum {
    double seconds = 0, macs = 0;
    int nodes = 0;
  };
  std::map<std::string, Sum> sums;
  for (const NodeProfile& node : profile) {
    Sum& sum = sums[node.kernel];
    sum.seconds += node.seconds;
    sum.macs += node.macs;
    ++sum.nodes;
  }
  std::vector<std::pair<std::string, Sum>> sorted(sums.begin(), sums.end());
  std::ranges::sort(sorted, [](const auto& x, const auto& y) { return x.second.seconds > y.second.seconds; });
  json all = json::array();
  for (const auto& [kernel, sum] : sorted)
    all.push_back({{"kernel", kernel},
                   {"nodes", sum.nodes},
                   {"ms", 1e3 * sum.seconds},
                   {"gflops", sum.seconds > 0 ? 2e-9 * sum.macs / sum.seconds : 0}});
  return all;
}

json by_node(const Profile& profile) {
  json all = json::array();
  for (const NodeProfile& node : profile)
    all.push_back({{"node", node.node},
                   {"kernel", node.kernel},
                   {"ms", 1e3 * node.seconds},
                   {"gflops", node.gflops()},
                   {"gbytes", node.gigabytes_per_second()}});
  return all;
}

/// Obeys one line after the other: see benchmarks/peers/README.md.
void serve(Bench& bench) {
  say(bench.facts());
  for (std::string line; std::getline(std::cin, line) && line != "quit";) {
    if (line == "run")
      say({{"ms", bench.run()}});
    else if (line.starts_with("output ")) {
      bench.write_output(line.substr(7));
      say(json::object());
    } else if (line == "kernels")
      say({{"kernels", by_kernel(median_profile(bench, kProfiledRuns))}});
    else if (line == "facts")
      say(bench.facts());
    else
      throw Error(ErrorKind::kUsage, "no command: " + line);
  }
}

json measure(Bench& bench, const Arguments& a) {
  bench.run();
  std::vector<double> times;
  times.reserve(static_cast<std::size_t>(a.runs));
  for (int i = 0; i < a.runs; ++i) times.push_back(bench.run());
  std::ranges::sort(times);
  json report = bench.facts();
  report["ms"] = times[times.size() / 2];
  report["ms_all"] = times;
  report["gflops"] = 1e3 * bench.gflop() / times[times.size() / 2];
  if (a.profile || a.nodes) {
    const Profile profile = median_profile(bench, a.runs);
    if (a.profile) report["kernels"] = by_kernel(profile);
    if (a.nodes) report["nodes"] = by_node(profile);
  }
  if (!a.reference.empty()) report["error"] = bench.errors(a.reference);
  return report;
}

void print(const json& report, const Arguments& a) {
  std::printf("%s %s, %s, %s, %d threads\n", a.network.c_str(), a.size.c_str(), a.precision.c_str(),
              report["isa"].get<std::string>().c_str(), report["threads"].get<int>());
  std::printf("  run     %10.2f ms (median of %d), %.1f GFLOP, %.1f GFLOP/s\n", report["ms"].get<double>(),
              a.runs, report["gflop"].get<double>(), report["gflops"].get<double>());
  std::printf("  load    %10.2f ms\n", report["load_ms"].get<double>());
  std::printf("  memory  %10.1f MiB peak, %.1f MiB planned\n", report["peak_kib"].get<double>() / 1024,
              report["planned_bytes"].get<double>() / (1 << 20));
  if (report.contains("error"))
    for (const auto& [name, e] : report["error"].items())
      std::printf("  output %s: max error %.2e, RMS %.2e\n", name.c_str(), e["max"].get<double>(),
                  e["rms"].get<double>());
  if (report.contains("kernels"))
    for (const json& k : report["kernels"])
      std::printf("  %9.2f ms %8.1f GFLOP/s  %4d x %s\n", k["ms"].get<double>(), k["gflops"].get<double>(),
                  k["nodes"].get<int>(), k["kernel"].get<std::string>().c_str());
  if (report.contains("nodes"))
    for (const json& n : report["nodes"])
      std::printf("  %9.3f ms %8.1f GFLOP/s %6.1f GB/s  %s  %s\n", n["ms"].get<double>(),
                  n["gflops"].get<double>(), n["gbytes"].get<double>(),
                  n["kernel"].get<std::string>().c_str(), n["node"].get<std::string>().c_str());
}

int run(CLI::App& app, int argc, char** argv) {
  Arguments a;
  app.add_option("NETWORK", a.network, "a model of the catalogue, or layering")->required();
  app.add_option("--size", a.size, "HEIGHTxWIDTH of the input; default: that of --inputs");
  app.add_option("--weights", a.weights, "weight file (safetensors; its calibration is used), or formula")
      ->capture_default_str();
  app.add_option("--inputs", a.inputs, "tensors input.NAME (safetensors); default: made-up ones");
  app.add_option("--reference", a.reference,
                 "tensors output.N in float64 to compare with; made by the float64 executor if missing");
  app.add_option("--precision", a.precision, "fp32, bf16, int8 or auto")->capture_default_str();
  app.add_option("--error-budget", a.error_budget, "fastest kernels with this predicted error, 1e-7 to 1");
  app.add_option(
      "--isa", a.isa,
      "kernels up to this level: baseline, avx2, avxvnni, avx512, avx512vnni, avx512bf16, amx, "
      "neon, neondot, neoni8mm, neonbf16; or of one without some features: avx512bf16,-avx512_vnni");
  app.add_option("--threads", a.threads, "0: one a core")->check(CLI::Range(0, 1024));
  app.add_option("--runs", a.runs, "runs after the first, of which the median counts")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_flag("--json", a.json, "print a JSON object");
  app.add_flag("--profile", a.profile, "also the time by kernel (sums of the nodes' medians)");
  app.add_flag("--nodes", a.nodes, "also the time by node (median of the runs)");
  app.add_flag("--serve", a.serve, "obey lines from standard input");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  if (!a.isa.empty()) {
    set_isa(isa_from_text(a.isa, "--isa"));
  }
  set_thread_count(a.threads);
  Bench bench(a);
  if (a.serve) {
    serve(bench);
    return 0;
  }
  const json report = measure(bench, a);
  if (a.json)
    std::cout << report.dump(1) << "\n";
  else
    print(report, a);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    CLI::App app("Times a network of this build and measures its error.");
    return run(app, argc, argv);
  } catch (const Error& e) {
    std::cerr << "slide_bench: " << e.what() << "\n";
    return exit_code(e.kind());
  } catch (const std::exception& e) {
    std::cerr << "slide_bench: internal error: " << e.what() << "\n";
    return exit_code(ErrorKind::kInternal);
  }
}
