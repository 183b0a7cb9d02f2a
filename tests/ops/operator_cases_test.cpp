#include <doctest/doctest.h>

#include <limits>
#include <map>
#include <set>
#include <string>

#include "ops/case_file.h"
#include "ops/case_io.h"
#include "ops/check.h"
#include "runtime/cpu.h"

using namespace slide;

TEST_CASE(
    "the definitions agree with PyTorch in float64, and every kernel keeps its bound on the same calls") {
  const std::vector<std::string> files = ops::case_files(SLIDE_TEST_DATA "/operator_cases");
  CHECK(files.size() == 168);
  std::set<std::string> operators, methods;
  for (const std::string& file : files) {
    const std::string name = file.substr(file.rfind('/') + 1);
    CAPTURE(name);
    const ops::CaseCheck result = ops::check_case(ops::read_case(file), detected_isa());
    operators.insert(result.op);
    CHECK(result.reference_passed());
    CHECK_FALSE(result.kernels.empty());
    for (const ops::KernelCheck& kernel : result.kernels) {
      INFO(kernel.kernel, ": ", kernel.verdict(), ", ", kernel.of_bound, " of its bound");
      CHECK(kernel.passed());
      methods.insert(kernel.kernel.substr(0, kernel.kernel.rfind('.')));
    }
  }
  CHECK(operators.size() == 52);
  // All methods of convolutions but one, which needs 2^15 weights; the other operators have one each.
  for (const char* method :
       {"depthwise", "few_filters", "winograd2", "winograd4", "winograd6", "grouped_gate", "direct", "gemm",
        "winograd4_bf16", "direct_bf16", "direct_int8"})
    CHECK(methods.contains(std::string("conv2d.") + method));
}

namespace {

/// Kernels that no shipped case reaches, by name without level, and why.
const std::map<std::string, std::string> kNotShipped = {
    {"conv2d.winograd2_bf16", "takes 2^15 weights or more, a file of 300 KB: conv2d_winograd_test.cpp"},
};

/// Kernels that do a node of a graph, and all that its operator has, by name and level.
void collect(const Graph& graph, std::set<std::string>& reached, std::map<std::string, const Kernel*>& all) {
  for (const Node& node : graph.nodes()) {
    if (node.kind != NodeKind::kOp) continue;
    std::vector<Shape> shapes;
    for (const int i : node.inputs) shapes.push_back(graph.node(i).shape);
    for (const Kernel* kernel : node.op->kernels()) {
      all[kernel->name_and_level()] = kernel;
      if (kernel->supports(*node.op, shapes, node.shape)) reached.insert(kernel->name_and_level());
    }
  }
}

}  // namespace

TEST_CASE(
    "every kernel, method, level and precision compiled in is reached by a shipped case, or named here") {
  std::set<std::string> reached, operators, unused;
  std::map<std::string, const Kernel*> all;
  for (const char* folder : {"/operator_cases", "/onnx_cases", "/hard_cases"})
    for (const std::string& file : ops::case_files(std::string(SLIDE_TEST_DATA) + folder)) {
      const ops::OperatorCase c = ops::read_case(file);
      Graph graph;
      std::vector<std::pair<std::string, Value>> inputs;
      for (const auto& [name, tensor] : c.inputs)
        inputs.emplace_back(name, graph.input(name, tensor.shape()));
      static_cast<void>(ops::build_case(c.op, c.attributes, inputs));
      collect(graph, reached, all);
      operators.insert(c.op);
    }
  for (const std::string& op : ops::case_operators()) {
    CAPTURE(op);
    CHECK(operators.contains(op));
  }
  std::set<Precision> precisions;
  std::set<Isa> levels;
  for (const auto& entry : all) {
    const std::string method(entry.second->name());
    INFO(entry.first, ": no shipped case is for it");
    CHECK(reached.contains(entry.first) != kNotShipped.contains(method));  // reached: no longer to be named
    if (!reached.contains(entry.first)) unused.insert(method);
    precisions.insert(entry.second->precision());
    levels.insert(entry.second->isa());
  }
  CHECK(unused.size() == kNotShipped.size());  // or there is no such kernel
  CHECK(precisions.size() == 3);
  // All that this CPU runs are among them.
  for (const Isa isa : available_isas()) CHECK(levels.contains(isa));
}

TEST_CASE("a NaN or an infinity in any input reaches what the definition says, at every kernel") {
  std::set<std::string> operators;
  for (const char* folder : {"/operator_cases", "/onnx_cases"})
    for (const std::string& file : ops::case_files(std::string(SLIDE_TEST_DATA) + folder))
      for (const double bad :
           {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
            -std::numeric_limits<double>::infinity()}) {
        ops::OperatorCase c = ops::read_case(file);
        if (c.expected.count() > 4096) continue;  // convolutions: tests/ops/conv2d_test.cpp
        for (auto& input : c.inputs) {
          const std::string& name = input.first;
          Tensor& tensor = input.second;
          const Tensor sound = tensor;
          tensor = sound.to(DType::kF64).clone();
          tensor.mutable_data<double>()[static_cast<std::size_t>(tensor.count() * 2 / 3)] = bad;
          for (const ops::KernelCheck& kernel : ops::check_case(c, detected_isa()).kernels) {
            INFO(file, " with ", bad, " in ", name, ", ", kernel.kernel, ": ", kernel.verdict());
            CHECK(kernel.passed());
          }
          tensor = sound;
        }
        operators.insert(c.op);
      }
  CHECK(operators.size() == 53);
}

TEST_CASE("hard cases hold: large means, sums that cancel, both ends of float32's range, denormals") {
  const std::vector<std::string> files = ops::case_files(SLIDE_TEST_DATA "/hard_cases");
  CHECK(files.size() == 32);
  for (const std::string& file : files) {
    const ops::CaseCheck result = ops::check_case(ops::read_case(file), detected_isa());
    INFO(file);
    CHECK(result.reference_passed());
    CHECK_FALSE(result.kernels.empty());
    for (const ops::KernelCheck& kernel : result.kernels) {
      INFO(kernel.kernel, ": ", kernel.verdict(), ", ", kernel.of_bound, " of its bound");
      CHECK(kernel.passed());
    }
  }
}
