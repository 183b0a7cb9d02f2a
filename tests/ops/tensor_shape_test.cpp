#include "ops/tensor_shape/tensor_shape.h"

#include "judge.h"

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
