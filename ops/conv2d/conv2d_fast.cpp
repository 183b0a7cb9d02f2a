#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/conv2d/conv2d_expectation.h"
#include "ops/conv2d/conv2d_grouped_gate.h"
#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/depthwise/depthwise.h"
#include "ops/conv2d/direct/direct.h"
#include "ops/conv2d/few_filters/few_filters.h"
#include "ops/conv2d/winograd/winograd.h"
#include "ops/gemm/conv2d_gemm.h"
#include "ops/pointwise/unary_row.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)       \
  namespace level {                            \
  extern const Conv2dRoutines conv2d_routines; \
  }
SLIDE_EACH_WORD_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const Conv2dRoutines* const> conv2d_routines() {
#define SLIDE_LIST(level, enumerator) &level::conv2d_routines,
  static const Conv2dRoutines* const all[] = {SLIDE_EACH_WORD_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return all;
}

namespace {

/// Unit roundoffs by Precision: half a unit in the last of 24 and of 8 significant bits. Errors of integers
/// are measured against their own scale.
constexpr std::array kUnits = {0x1p-24, 0x1p-8, 1.0};

/// A method of conv2d_method.h with the routines of one level.
template <typename Method>
class Conv2dKernel : public Kernel {
 public:
  Conv2dKernel(std::string_view name, const Conv2dRoutines& routines)
      : name_(name), routines_(routines), expectation_(conv2d_expectation(name)) {}

  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] Isa isa() const override { return routines_.isa; }
  [[nodiscard]] Precision precision() const override { return Method::kPrecision; }
  [[nodiscard]] bool supports(const Op& op, std::span<const Shape> inputs,
                              const Shape& /*output*/) const override {
    if constexpr (requires { &Method::fits_tiles; })
      if (routines_.tile_depth > 1) return Method::fits_tiles(of(op).geometry(inputs), of(op).fusion());
    return Method::fits(of(op).geometry(inputs), of(op).fusion());
  }
  [[nodiscard]] bool replaces_lower(const Op& op, std::span<const Shape> inputs) const override {
    if constexpr (requires { &Method::replaces_lower; })
      return Method::replaces_lower(of(op).geometry(inputs));
    else
      return false;
  }
  [[nodiscard]] bool packs(std::size_t index) const override { return index == 1; }
  [[nodiscard]] std::size_t packed_bytes(const Op& op, std::span<const Shape> inputs,
                                         const Shape& /*output*/) const override {
    return method(op, inputs).packed_bytes();
  }
  void pack(const Op& op, std::span<const Tensor> inputs, std::span<const Shape> shapes,
            std::span<std::byte> packed) const override {
    method(op, shapes).pack(f32(inputs[1]), packed.data());
  }
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    return method(op, inputs).scratch_bytes();
  }
  /// The method's factor, one rounding of a residual, and for what the scale holds as |y|: elu (1 ULP, 2u),
  /// sigmoid (2.5 ULP, 5u) and their product (u), or the activation.
  [[nodiscard]] double error_factor(const Op& op, std::span<const Shape> inputs) const override {
    const Conv2dFusion& fusion = of(op).fusion();
    const double sums = method(op, inputs).error_factor() +
                        (fusion.residual && Method::kPrecision == Precision::kFp32 ? 1 : 0);
    if (Method::kPrecision == Precision::kInt8) return 1.01 * sums;
    const double functions = (fusion.gate ? 8 : 0) +
                             (fusion.activation ? unary_error_factor(*fusion.activation) : 0) +
                             (fusion.residual_last ? 1 : 0);
    return (fusion.gate || fusion.activation ? 1.01 : 1.0) * std::max(sums, functions);
  }
  /// A method whose errors are not relative to |w| ∗ |x| + |b| has an error_scale() of its own.
  [[nodiscard]] bool error_scale(const Op& op, std::span<const Tensor> inputs, const Tensor& output,
                                 Tensor& scale) const override {
    if constexpr (requires { &Method::error_scale; }) {
      const Conv2dGeometry g = of(op).geometry(shapes_of(inputs));
      std::vector<double> sums(static_cast<std::size_t>(g.output().count()));
      if constexpr (Method::kPrecision == Precision::kInt8) {
        const std::vector<Tensor> own = of(op).convolution_inputs(inputs);
        const bool changed = of(op).fusion().relu_input || of(op).fusion().joined > 0;
        Method::error_scale(g, own, changed ? own[0] : inputs[0], sums);
        of(op).error_scale_of_sums(inputs, sums, output, scale, 0x1p-20, 1);
      } else {
        Method::error_scale(g, of(op).scale_inputs(inputs), sums);
        of(op).error_scale_of_sums(inputs, sums, output, scale);
      }
      return true;
    } else {
      return Kernel::error_scale(op, inputs, output, scale);
    }
  }
  [[nodiscard]] double unit_roundoff() const override {
    return kUnits[static_cast<std::size_t>(Method::kPrecision)];
  }
  /// A transformed input's magnitude is the input's times `growth` at most; bfloat16 rounds to infinity what
  /// is beyond its largest number.
  [[nodiscard]] Domain domain() const override {
    constexpr double kLargestBf16 = 0x1.FEp127;
    Domain d;
    if (Method::kPrecision == Precision::kBf16) d.largest_input = kLargestBf16;
    if constexpr (requires { Method::kInputGrowth; }) d.largest_input /= Method::kInputGrowth;
    if (Method::kPrecision == Precision::kInt8 || requires { Method::kInputGrowth; }) d.reach = Reach::kImage;
    return d;
  }
  [[nodiscard]] double macs(const Op& op, std::span<const Shape> inputs,
                            const Shape& /*output*/) const override {
    return method(op, inputs).macs();
  }
  /// A residual is taken to be as large as the sums and without error.
  [[nodiscard]] double expected_error(const Op& op, std::span<const Shape> inputs) const override {
    const double sums =
        Method::kPrecision == Precision::kFp32
            ? expectation_.error * unit_roundoff() * std::sqrt(method(op, inputs).error_factor())
            : expectation_.error;
    return of(op).fusion().residual ? sums / std::numbers::sqrt2 : sums;
  }
  /// Of panels of rows that a group does not fill, all are computed.
  [[nodiscard]] double cost(const Op& op, std::span<const Shape> inputs, const Shape& output) const override {
    const Conv2dGeometry g = of(op).geometry(inputs);
    const auto rows = static_cast<double>(routines_.rows);
    const double filled = std::is_same_v<Method, Conv2dDepthwise> || g.groups == 1
                              ? 1
                              : std::min(1.0, static_cast<double>(g.group_oc) / rows);
    return macs(op, inputs, output) / (conv2d_speed(conv2d_costs(), name_, isa()) * filled);
  }
  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    const float* bias = of(op).geometry(call.shapes).has_bias ? f32(inputs[2]) : nullptr;
    const float* residual = of(op).fusion().residual ? f32(inputs[3]) : nullptr;
    const float* joined = of(op).fusion().joined > 0 ? f32(inputs.back()) : nullptr;
    method(op, call.shapes)
        .run({f32(inputs[0]), call.packed.data(), bias, residual, f32(output), call.range, joined},
             call.scratch);
  }

 private:
  [[nodiscard]] static const Conv2dOp& of(const Op& op) { return static_cast<const Conv2dOp&>(op); }
  [[nodiscard]] Method method(const Op& op, std::span<const Shape> inputs) const {
    return {routines_, of(op).geometry(inputs), of(op).fusion()};
  }

  std::string_view name_;
  const Conv2dRoutines& routines_;
  const Conv2dExpectation& expectation_;
};

/// Adds a method's kernel of each level that has the routines of its own.
template <typename Method>
void list(std::string_view name, std::vector<const Kernel*>& all) {
  static const KernelList<Conv2dKernel<Method>, Conv2dRoutines> kernels(name, [] {
    std::vector<const Conv2dRoutines*> levels;
    for (const Conv2dRoutines* level : conv2d_routines())
      if (level->whole || (level->own_words[static_cast<std::size_t>(Method::kPrecision)] &&
                           std::is_base_of_v<Conv2dDirect, Method>))
        levels.push_back(level);
    return levels;
  }());
  all.insert(all.end(), kernels.all().begin(), kernels.all().end());
}

}  // namespace

std::span<const Kernel* const> Conv2dOp::kernels() const {
  static const std::vector<const Kernel*> all = [] {
    std::vector<const Kernel*> methods;
    list<Conv2dDepthwise>("conv2d.depthwise", methods);
    list<Conv2dFewFilters>("conv2d.few_filters", methods);
    list<Conv2dWinograd<4>>("conv2d.winograd4", methods);
    list<Conv2dWinograd<2>>("conv2d.winograd2", methods);
    list<Conv2dGroupedGate>("conv2d.grouped_gate", methods);
    list<Conv2dDirect>("conv2d.direct", methods);
    list<Conv2dGemm>("conv2d.gemm", methods);
    list<Conv2dWinogradBf16<4>>("conv2d.winograd4_bf16", methods);
    list<Conv2dWinogradBf16<2>>("conv2d.winograd2_bf16", methods);
    list<Conv2dDirectInt8>("conv2d.direct_int8", methods);
    list<Conv2dDirectBf16>("conv2d.direct_bf16", methods);
    list<Conv2dWinograd<6>>("conv2d.winograd6",
                            methods);  // behind the one that can do anything: by name only
    return methods;
  }();
  return all;
}

}  // namespace slide::ops
