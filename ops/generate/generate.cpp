#include "ops/generate/generate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include "ops/case_file.h"
#include "ops/generate/draft.h"
#include "ops/generate/numbers.h"
#include "ops/judge.h"
#include "runtime/error.h"
#include "runtime/own_file.h"
#include "runtime/safetensors.h"

namespace slide::ops {
namespace {

constexpr std::string_view kSource = "slide_check generate ";
constexpr double kLargest = std::numeric_limits<float>::max();

/// Inputs for the draft, all of one trial; of denormals and infinities only the first input holds any, so
/// that what comes of them is to be seen.
void fill(OperatorCase& c, const CallDraft& draft, Trial trial, int reach, Random r) {
  c.inputs.clear();
  bool first = true;
  for (const CallDraftInput& input : draft.inputs) {
    const bool single = trial == Trial::kSpecials || trial == Trial::kDenormal;
    c.inputs.emplace_back(input.name,
                          numbers_for(input, single && !first ? Trial::kRandom : trial, reach, r));
    first = false;
  }
}

/// Whether partial results stay within float32 wherever the result does.
bool within_float(const CaseValues& values) {
  const std::span<const double> y = values.y64.data<double>();
  const std::span<const double> scale = values.scale.data<double>();
  for (std::size_t i = 0; i < y.size(); ++i)
    if (std::fabs(y[i]) <= kLargest && !(scale[i] <= kLargest)) return false;
  return true;
}

/// Whether an operator that takes denormal inputs for zero keeps within what judge() allows for flushing.
bool survives_flushing(const OperatorCase& c, const CaseValues& values) {
  OperatorCase flushed = c;
  for (auto& input : flushed.inputs) {
    input.second = input.second.clone();
    for (float& v : input.second.mutable_data<float>())
      if (std::fpclassify(v) == FP_SUBNORMAL) v = 0;
  }
  const Tensor other = values_of(flushed, false).y64;
  const std::span<const double> y = values.y64.data<double>();
  for (std::size_t i = 0; i < y.size(); ++i)
    if (!(std::fabs(y[i] - other.data<double>()[i]) <= 0x1p-126) &&
        !(std::isnan(y[i]) && std::isnan(other.data<double>()[i])))
      return false;
  return true;
}

/// Fills the case with numbers that reach as far as its answer can be held to.
CaseValues solve(OperatorCase& c, const CallDraft& draft, Trial trial, const Random& random) {
  const auto attempt = [&](int reach) {
    fill(c, draft, trial, reach, random);
    return values_of(c, true);
  };
  if (trial == Trial::kDenormal) {
    CaseValues values = attempt(149);
    return survives_flushing(c, values) ? values : attempt(126);
  }
  if (trial == Trial::kRange)
    for (const int part : {120, 90, 60, 40, 30, 20, 15}) {
      const int reach = part * draft.most_reach / 120;
      CaseValues values = attempt(reach);
      if (within_float(values)) return values;
    }
  return attempt(10);
}

}  // namespace

std::string_view name_of(Trial trial) {
  constexpr std::array<std::string_view, kTrials> kNames = {
      "random", "integers", "constant", "large_mean", "cancelling", "specials", "denormal", "range"};
  return kNames[static_cast<std::size_t>(trial)];
}

Trial trial_of(std::uint64_t index) { return static_cast<Trial>(index % kTrials); }

OperatorCase generate_case(std::string_view op, std::uint64_t seed, std::uint64_t index) {
  Random random(op, seed, index);
  const CallDraft draft = draft_call(op, random);
  Trial trial = trial_of(index);
  if (draft.bounded && (trial == Trial::kSpecials || trial == Trial::kRange)) trial = Trial::kRandom;
  OperatorCase c;
  c.op = op;
  c.attributes = draft.attributes.dump();
  c.source = std::string(kSource) + c.op + " --seed " + std::to_string(seed) + ", case " +
             std::to_string(index) + ": " + std::string(name_of(trial));
  const CaseValues values = solve(c, draft, trial, random);
  c.expected = values.y64;
  c.scale = values.scale;
  return c;
}

namespace {

/// Whether a file is a case that generate_files() has written and nobody has changed since.
bool is_generated(const std::string& path) {
  try {
    const SafetensorsFile file = SafetensorsFile::open(path);
    const auto source = file.metadata().find("source");
    return source != file.metadata().end() && source->second.starts_with(kSource) && file.has_checksums() &&
           file.verify_crc() == file.tensors().size();
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadWeights) throw;
    return false;
  }
}

struct Planned {
  std::string op;
  std::uint64_t index;
  std::string path;
};

std::vector<Planned> plan(std::string_view op, std::uint64_t seed, int count, const std::string& folder) {
  std::vector<Planned> result;
  for (const std::string& name : op == "all" ? case_operators() : std::vector{std::string(op)}) {
    Random random(name, seed, 0);
    static_cast<void>(draft_call(name, random));  // there is such an operator
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(count); ++i) {
      char number[24];
      std::snprintf(number, sizeof number, "_%04llu_", static_cast<unsigned long long>(i));
      const std::string file = name + "_" + std::to_string(seed) + number + std::string(name_of(trial_of(i)));
      result.push_back({name, i, (std::filesystem::path(folder) / (file + ".safetensors")).string()});
    }
  }
  return result;
}

}  // namespace

std::size_t generate_files(std::string_view op, std::uint64_t seed, int count, const std::string& folder,
                           bool overwrite) {
  const std::vector<Planned> files = plan(op, seed, count, folder);
  if (!overwrite)
    for (const Planned& file : files) require_own_file(file.path, is_generated);
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(ErrorKind::kOutput, folder + ": cannot make the folder: " + error.message());
  for (const Planned& file : files) write_case(file.path, generate_case(file.op, seed, file.index));
  return files.size();
}

}  // namespace slide::ops
