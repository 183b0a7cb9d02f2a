#include "ops/judge.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>

#include "ops/case_file.h"
#include "ops/judge_patterns.h"
#include "ops/textbook_scale.h"
#include "runtime/error.h"

namespace slide::ops {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFloatRoundoff = 0x1p-24;

struct UnitFacts {
  std::string_view name;
  Unit unit;
  double roundoff;
  double largest;  // beyond it a result is an infinity
};
constexpr double kFloatLargest = std::numeric_limits<float>::max();
constexpr std::array<UnitFacts, 5> kUnits = {{{"fp32", Unit::kFp32, kFloatRoundoff, kFloatLargest},
                                              {"tf32", Unit::kTf32, 0x1p-11, kFloatLargest},
                                              {"bf16", Unit::kBf16, 0x1p-8, kFloatLargest},
                                              {"fp16", Unit::kFp16, 0x1p-11, 65504},
                                              {"int8", Unit::kInt8, 1.0 / 254, kFloatLargest}}};

const UnitFacts& facts_of(Unit unit) { return *std::ranges::find(kUnits, unit, &UnitFacts::unit); }

std::vector<Shape> shapes_of(const std::vector<Tensor>& tensors) {
  std::vector<Shape> shapes;
  shapes.reserve(tensors.size());
  for (const Tensor& t : tensors) shapes.push_back(t.shape());
  return shapes;
}

enum class Program { kOurs, kTextbook };

/// The scale of a node's own errors, and what those of its inputs become: |f(x + h·s) - f(x)| / h.
Tensor scale_of(const Op& op, const std::vector<Tensor>& inputs, const std::vector<Tensor>& scales,
                const Tensor& output, Program program) {
  constexpr double kStep = 0x1p-30;
  Tensor scale(DType::kF64, output.shape());
  op.error_scale(inputs, output, scale);
  const std::span<double> sum = scale.mutable_data<double>();
  if (program == Program::kTextbook) add_textbook_scale(op, inputs, sum);
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    if (scales[k].empty()) continue;
    std::vector<Tensor> moved = inputs;
    moved[k] = inputs[k].clone();
    for (std::size_t i = 0; i < static_cast<std::size_t>(moved[k].count()); ++i)
      moved[k].mutable_data<double>()[i] += kStep * scales[k].data<double>()[i];
    Tensor result(DType::kF64, output.shape());
    op.reference(moved, result);
    for (std::size_t i = 0; i < sum.size(); ++i)
      sum[i] += std::fabs(result.data<double>()[i] - output.data<double>()[i]) / kStep;
  }
  return scale;
}

/// Quotients that differ by less are equal: which is larger would depend on how a compiler rounds.
constexpr double kTie = 1e-6;

double largest_factor(const Op& op, const std::vector<Shape>& shapes, const Shape& output) {
  double factor = 1;
  for (const Kernel* kernel : op.kernels())
    if (kernel->precision() == Precision::kFp32 && kernel->supports(op, shapes, output))
      factor = std::max(factor, kernel->error_factor(op, shapes));
  return factor;
}

/// In 8 bits the step is one for a whole tensor, so the largest element's error may be everybody's.
void level(Tensor& scale) {
  const double largest = max_abs(scale);
  std::ranges::fill(scale.mutable_data<double>(), largest);
}

/// Whether the terms of either sign alone, (scale ± |y64|)/2, go beyond float32: then no order of summation
/// keeps a sum from infinity minus infinity.
bool may_be_lost(double y64, double scale) {
  constexpr double kLargestFloat = 0x1.FFFFFEp127;
  return (scale - std::fabs(y64)) / 2 > kLargestFloat;
}

double difference(double a, double b) {
  if (a == b || (std::isnan(a) && std::isnan(b))) return 0;
  const double d = std::fabs(a - b);
  return std::isnan(d) ? kInfinity : d;
}

std::vector<std::int64_t> index_of(const Shape& shape, std::size_t element) {
  std::vector<std::int64_t> index(static_cast<std::size_t>(shape.rank()));
  auto rest = static_cast<std::int64_t>(element);
  for (int axis = shape.rank() - 1; axis >= 0; --axis) {
    index[static_cast<std::size_t>(axis)] = rest % shape[axis];
    rest /= shape[axis];
  }
  return index;
}

std::string text_of(const WrongElement& e) {
  std::string index;
  for (const std::int64_t i : e.index) index += (index.empty() ? "" : ", ") + std::to_string(i);
  char numbers[160];
  std::snprintf(numbers, sizeof numbers, "is %.9g, should be %.9g, bound %.2g", e.actual, e.expected,
                e.bound);
  return "[" + index + "] " + numbers;
}

}  // namespace

std::optional<Unit> unit_from_name(std::string_view name) {
  const auto* found = std::ranges::find(kUnits, name, &UnitFacts::name);
  if (found == kUnits.end()) return std::nullopt;
  return found->unit;
}

CaseValues values_of(const OperatorCase& c, bool rounded) {
  Graph graph;
  std::vector<std::pair<std::string, Value>> inputs;
  for (const auto& [name, tensor] : c.inputs) inputs.emplace_back(name, graph.input(name, tensor.shape()));
  const auto result = static_cast<std::size_t>(build_case(c.op, c.attributes, inputs).node());
  CaseValues values;
  std::vector<Tensor> value(graph.nodes().size());
  std::vector<Tensor> scale(graph.nodes().size());
  std::vector<Tensor> textbook(graph.nodes().size());
  for (std::size_t i = 0; i < value.size(); ++i) {
    const Node& node = graph.nodes()[i];
    if (node.kind == NodeKind::kConstant) value[i] = node.constant;
    if (node.kind == NodeKind::kInput)
      for (const auto& [name, tensor] : c.inputs)
        if (name == node.name) value[i] = (rounded ? tensor.to(DType::kF32) : tensor).to(DType::kF64);
    if (node.kind != NodeKind::kOp) continue;
    std::vector<Tensor> arguments;
    std::vector<Tensor> scales, textbook_scales;
    for (const int j : node.inputs) {
      arguments.push_back(value[static_cast<std::size_t>(j)]);
      scales.push_back(scale[static_cast<std::size_t>(j)]);
      textbook_scales.push_back(textbook[static_cast<std::size_t>(j)]);
    }
    value[i] = Tensor(DType::kF64, node.shape);
    node.op->reference(arguments, value[i]);
    scale[i] = scale_of(*node.op, arguments, scales, value[i], Program::kOurs);
    textbook[i] = scale_of(*node.op, arguments, textbook_scales, value[i], Program::kTextbook);
    const std::vector<Shape> shapes = shapes_of(arguments);
    const double count = static_cast<double>(std::max<std::int64_t>(1, node.shape.count()));
    values.terms = std::max(values.terms, node.op->macs(shapes, node.shape) / count);
    values.factor = std::max(values.factor, largest_factor(*node.op, shapes, node.shape));
  }
  values.y64 = value[result];
  const auto or_zero = [&](const Tensor& t) {
    return t.empty() ? Tensor::zeros(DType::kF64, values.y64.shape()) : t;
  };
  values.scale = or_zero(scale[result]);
  values.textbook = or_zero(textbook[result]);
  return values;
}

double float_factor(const CaseValues& values) { return std::max(1.001 * (values.terms + 3), values.factor); }

Judgement judge(const OperatorCase& c, const Tensor& actual, Unit unit, std::optional<double> factor) {
  const DType type = actual.dtype();
  if (type != DType::kF32 && type != DType::kF64 && type != DType::kF16 && type != DType::kBF16)
    throw Error(ErrorKind::kBadInput, "the result to judge is " + std::string(name_of(type)),
                "convert it to float32");
  Judgement result;
  CaseValues values = values_of(c, true);
  result.elements = values.y64.count();
  if (actual.shape() != values.y64.shape()) {
    result.problem = "the shape is " + actual.shape().text() + ", it should be " + values.y64.shape().text();
    return result;
  }
  const UnitFacts& facts = facts_of(unit);
  if (unit == Unit::kInt8) level(values.scale);
  const double sums = float_factor(values) * kFloatRoundoff / facts.roundoff;
  const double usual = unit == Unit::kFp32 ? sums : 3 + sums;
  result.factor = factor.value_or(usual);
  const Tensor wide = actual.to(DType::kF64);
  const std::span<const double> y = wide.data<double>();
  const std::span<const double> y64 = values.y64.data<double>();
  const std::span<const double> scale = values.scale.data<double>();
  std::vector<std::size_t> wrong;
  double squares = 0;
  double norm = 0;
  double predicted = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    if (!std::isfinite(y[i]) && may_be_lost(y64[i], scale[i])) continue;
    const double should = std::fabs(y64[i]) > facts.largest ? std::copysign(kInfinity, y64[i]) : y64[i];
    const double bound = result.factor * facts.roundoff * scale[i] + std::max(result.factor, 1.0) * 0x1p-126;
    const double error = difference(y[i], should);
    const double units = std::isnan(bound) ? 0 : error == 0 ? 0 : error / bound;
    if (std::isfinite(should)) {
      squares += error * error;
      norm += should * should;
      predicted += scale[i] * scale[i];
    }
    if (units > 1 || (error > 0 && std::isnan(bound))) {
      wrong.push_back(i);
      const WrongElement element{index_of(actual.shape(), i), y[i], should, bound};
      if (!result.first) result.first = element;
      if (!result.worst || units > (1 + kTie) * result.of_bound) result.worst = element;
    }
    result.of_bound = std::max(result.of_bound, units);
  }
  result.wrong = static_cast<std::int64_t>(wrong.size());
  const double size = norm > 0 ? norm : 1;
  result.rms = std::sqrt(squares / size);
  // Roundings of 0.3 u each; of the sum's, on the way to its n terms, a third.
  const double roundings = unit == Unit::kFp32 ? values.terms / 3 + 1 : 3 / std::max(1.0, values.terms);
  result.expected_rms = 0.3 * facts.roundoff * std::sqrt(roundings * predicted / size);
  const double flushed =
      std::sqrt(static_cast<double>(y.size()) / size) * std::max(result.factor, 1.0) * 0x1p-126;
  result.rms_limit = kRmsAllowance * std::max(1.0, result.factor / usual) * result.expected_rms + flushed;
  result.patterns = patterns_of({c, values.y64, wide, wrong});
  return result;
}

std::string text_of(const Judgement& j) {
  if (!j.problem.empty()) return "WRONG: " + j.problem + "\n";
  char text[256];
  std::snprintf(text, sizeof text,
                "%s: %lld of %lld elements over their bound, at most %.3g of it (factor %.3g)\n",
                j.passed() ? "right" : "WRONG", static_cast<long long>(j.wrong),
                static_cast<long long>(j.elements), j.of_bound, j.factor);
  std::string result = text;
  if (j.first) result += "first: " + text_of(*j.first) + "\n";
  if (j.worst) result += "worst: " + text_of(*j.worst) + "\n";
  std::snprintf(text, sizeof text, "rms error %.2e, independent roundings would make about %.2e%s\n", j.rms,
                j.expected_rms, j.rms <= j.rms_limit ? "" : ": too large");
  result += text;
  for (const std::string& pattern : j.patterns) result += "pattern: " + pattern + "\n";
  return result;
}

}  // namespace slide::ops
