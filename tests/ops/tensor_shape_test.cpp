#include "ops/tensor_shape/tensor_shape.h"

#include "judge.h"
#include "ops/pointwise/pointwise.h"
#include "runtime/fast_executor.h"
#include "runtime/reference_executor.h"

using namespace slide;
using test::Call;
using test::call_of;
using test::random_tensor;
using test::tensor_of;
using test::values;

TEST_CASE("concat joins along any axis and slice takes the parts out again") {
  for (int axis = -4; axis < 4; ++axis) {
    const Shape shape{2, 3, 4, 5};
    const Shape longer = shape.with(axis, 7);
    const Tensor a = random_tensor(shape, 1);
    const Tensor b = random_tensor(longer, 2);
    const Call joined({a, b, a}, [&](const std::vector<Value>& v) { return ops::concat(v, axis); });
    test::judge(joined);
    const Tensor y = joined.reference();
    const std::int64_t first = shape[axis];
    const Call part = call_of(y, [&](Value v) { return ops::slice(v, axis, first, first + 7); });
    test::judge(part);
    CHECK(values(part.reference()) == values(b));
    const Call head = call_of(y, [&](Value v) { return ops::slice(v, axis, 0, first); });
    CHECK(values(head.reference()) == values(a));
  }
}

TEST_CASE("padding repeats, mirrors or fills, on each side by its own amount") {
  const Tensor x = tensor_of({1, 1, 1, 4}, {1, 2, 3, 4});
  const auto padded = [&](ops::PadMode mode) {
    const Call call = call_of(x, [&](Value v) { return ops::pad(v, {0, 3, 0, 2}, mode, 9); });
    test::judge(call);
    return values(call.reference());
  };
  CHECK(padded(ops::PadMode::kConstant) == std::vector<double>{9, 9, 9, 1, 2, 3, 4, 9, 9});
  CHECK(padded(ops::PadMode::kEdge) == std::vector<double>{1, 1, 1, 1, 2, 3, 4, 4, 4});
  CHECK(padded(ops::PadMode::kReflect) == std::vector<double>{4, 3, 2, 1, 2, 3, 4, 3, 2});
  const Call column = call_of(tensor_of({1, 1, 3, 1}, {1, 2, 3}), [](Value v) {
    return ops::pad(v, {2, 0, 1, 0}, ops::PadMode::kReflect);
  });
  CHECK(values(column.reference()) == std::vector<double>{3, 2, 1, 2, 3, 2});
  for (const ops::PadMode mode : {ops::PadMode::kConstant, ops::PadMode::kEdge, ops::PadMode::kReflect})
    test::judge(call_of(random_tensor({2, 3, 5, 7}, 3), [&](Value v) {
      return ops::pad(v, {1, 6, 4, 2}, mode, 0.1);
    }));
}

TEST_CASE("reshape keeps the elements in order") {
  const Call call = call_of(random_tensor({2, 3, 4}, 1), [](Value v) { return ops::reshape(v, {4, 6}); });
  CHECK(values(call.reference()) == values(call.inputs[0]));
  test::judge(call);
}

TEST_CASE("shapes that do not fit are refused with both shapes") {
  Graph g;
  const Value a = g.input("a", {1, 2, 3, 4});
  const Value b = g.input("b", {1, 2, 5, 4});
  CHECK(test::refusal([&] {
          (void)ops::concat({a, b}, 1);
        }) == "layer concat: cannot join 1x2x3x4 and 1x2x5x4 along axis 1");
  CHECK(test::refusal([&] { (void)ops::concat({a, b}, 4); }).find("axis 4") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::concat({}, 0); }).find("no tensor") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::slice(a, 2, 1, 4); }).find("1 to 4 of axis 2 of 1x2x3x4") !=
        std::string::npos);
  CHECK(test::refusal([&] { (void)ops::slice(a, 2, 2, 2); }).find("2 to 2") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::slice(a, 7, 0, 1); }).find("axis 7") != std::string::npos);
  CHECK(test::refusal([&] {
          (void)ops::pad(a, {3, 0, 0, 0}, ops::PadMode::kReflect);
        }).find("less than the extent") != std::string::npos);
  CHECK(test::refusal([&] {
          (void)ops::pad(a, {-1, 0, 0, 0}, ops::PadMode::kEdge);
        }).find("-1") != std::string::npos);
  CHECK(test::refusal([&] { (void)ops::reshape(a, {5, 5}); }).find("1x2x3x4 to 5x5") != std::string::npos);
}

namespace {

const PlanStep& step_of(const Plan& plan, const Graph& g, std::string_view name) {
  for (const PlanStep& step : plan.steps)
    if (step.node == g.find(name)) return step;
  throw Error(ErrorKind::kInternal, "no step");
}

void check_against_reference(const Graph& g, const Shape& shape, double tolerance) {
  const NamedTensors inputs = {{"x", random_tensor(shape, 5).to(DType::kF32)}};
  FastExecutor fast(g, WeightMap());
  ReferenceExecutor reference(g, WeightMap());
  reference.run(inputs);
  for (int round = 0; round < 2; ++round) {
    fast.run(inputs);
    for (const auto& [name, node] : g.outputs())
      CHECK(max_abs_difference(fast.tensor(node), reference.tensor(node)) <= tolerance);
  }
}

}  // namespace

TEST_CASE("what is joined is computed where the result has it, and read there by others too") {
  Graph g;
  const Shape shape{1, 2, 8, 16};
  const Value x = g.input("x", shape);
  g.tap("a", ops::relu(x));
  const Value a(g, *g.find("a"));
  const Value b = ops::affine(a, 2, 1);
  g.tap("b", b);
  const Value inner = ops::concat({b, a}, 1);
  g.tap("inner", inner);
  const Value outer = ops::concat({ops::affine(b, 3, 0), inner}, 1);
  g.tap("outer", outer);
  g.output("y", ops::affine(outer, 1, 1));
  g.output("z", ops::affine(ops::add(a, b), 1, 0.5));
  const Plan plan = make_plan(g, Isa::kBaseline);
  const std::size_t bytes = 2 * 8 * 16 * sizeof(float);
  const std::size_t start = step_of(plan, g, "outer").offset;
  CHECK(step_of(plan, g, "inner").offset == start + bytes);
  CHECK(step_of(plan, g, "b").offset == start + bytes);
  CHECK(step_of(plan, g, "a").offset == start + 2 * bytes);
  CHECK(step_of(plan, g, "inner").in_place);
  CHECK(step_of(plan, g, "outer").in_place);
  CHECK_FALSE(step_of(plan, g, "b").in_place);
  check_against_reference(g, shape, 1e-5);
}

TEST_CASE("a tensor has one place: other joins, and joins of inputs, copy") {
  Graph g;
  const Shape shape{1, 2, 8, 16};
  const Value x = g.input("x", shape);
  const Value a = ops::relu(x);
  const Value twice = ops::concat({a, a}, 1);
  g.tap("twice", twice);
  const Value again = ops::concat({a, x}, 1);
  g.tap("again", again);
  const Value along_rows = ops::concat({ops::affine(x, 1, 2), ops::affine(x, 1, 3)}, 2);
  g.tap("along_rows", along_rows);
  g.output("y", ops::affine(twice, 1, 1));
  g.output("z", ops::affine(again, 1, 1));
  g.output("r", along_rows);
  const Plan plan = make_plan(g, Isa::kBaseline);
  CHECK_FALSE(step_of(plan, g, "twice").in_place);
  CHECK_FALSE(step_of(plan, g, "again").in_place);
  CHECK_FALSE(step_of(plan, g, "along_rows").in_place);
  check_against_reference(g, shape, 1e-6);
}

TEST_CASE("parts and reshapes of what is computed are where they are; misaligned ones are copied") {
  Graph g;
  const Shape shape{1, 4, 4, 4};
  const Value x = g.input("x", shape);
  const Value a = ops::affine(x, 2, 1);
  g.tap("a", a);
  const Value part = ops::slice(a, 1, 1, 3);
  g.tap("part", part);
  const Value flat = ops::reshape(part, {1, 2, 1, 16});
  g.tap("flat", flat);
  const Value odd = ops::slice(ops::reshape(a, {64}), 0, 3, 9);
  g.tap("odd", odd);
  g.output("y", ops::affine(flat, 1, 1));
  g.output("z", ops::affine(odd, 1, 1));
  const Plan plan = make_plan(g, Isa::kBaseline);
  CHECK(step_of(plan, g, "part").offset == step_of(plan, g, "a").offset + 64);
  CHECK(step_of(plan, g, "flat").offset == step_of(plan, g, "a").offset + 64);
  CHECK(step_of(plan, g, "part").in_place);
  CHECK(step_of(plan, g, "flat").in_place);
  CHECK_FALSE(step_of(plan, g, "odd").in_place);
  check_against_reference(g, shape, 1e-6);
}

TEST_CASE("a join that would keep memory too long is copied: sharing never makes a plan larger") {
  Graph g;
  const Shape shape{1, 1, 64, 64};
  const Value x = g.input("x", shape);
  const Value early = ops::relu(x);
  Value deep = ops::concat({x, x, x, x}, 1);
  deep = ops::affine(deep, 1, 1);
  deep = ops::slice(ops::affine(deep, 1, 2), 1, 0, 3);
  const Value late = ops::affine(deep, 1, 3);
  g.output("y", ops::concat({early, late}, 1));
  const Plan plan = make_plan(g, Isa::kBaseline);
  CHECK(plan.arena_bytes <= (1 + 4 + 4) * 64 * 64 * sizeof(float));
  check_against_reference(g, shape, 1e-5);
}

TEST_CASE(
    "a permuted tensor has each element where its index goes, over many tasks and planes of any width") {
  struct Case {
    Shape x;
    std::vector<int> axes;
  };
  for (const Case& c : {Case{{6, 4, 4, 37, 37}, {0, 3, 1, 4, 2}}, Case{{3, 2, 2, 19, 151}, {0, 3, 1, 4, 2}},
                        Case{{130, 300}, {1, 0}}, Case{{5}, {0}}, Case{{7, 3, 11}, {2, 0, 1}},
                        Case{{2, 3, 40, 200}, {0, 2, 3, 1}}, Case{{4, 1, 3}, {1, 0, 2}}}) {
    const test::Call call = test::call_of(test::tensor_by(c.x, [](std::int64_t i) { return i; }),
                                          [&](Value v) { return ops::permute(v, c.axes); });
    INFO(call.op->attributes(), " of ", c.x.text());
    const std::vector<double> y = test::values(call.reference());
    bool right = true;
    for (std::int64_t i = 0; i < c.x.count(); ++i) {
      std::vector<std::int64_t> index(static_cast<std::size_t>(c.x.rank()));
      std::int64_t rest = i;
      for (int k = c.x.rank() - 1; k >= 0; rest /= c.x[k--])
        index[static_cast<std::size_t>(k)] = rest % c.x[k];
      std::int64_t at = 0;
      for (const int axis : c.axes) at = at * c.x[axis] + index[static_cast<std::size_t>(axis)];
      right = right && y[static_cast<std::size_t>(at)] == static_cast<double>(i);
    }
    CHECK(right);
    test::judge(call);
  }
}
