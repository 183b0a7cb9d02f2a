#include "ops/fill/mirror.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "kernel_bounds.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"

using namespace slide;
using slide::test::Call;

namespace {

Call mirror_call(const Tensor& x, const Tensor& weight) {
  return {{x, weight}, [](const std::vector<Value>& v) { return ops::mirror_known(v[0], v[1]); }};
}

Tensor row(const std::vector<double>& values) {
  Tensor t(DType::kF64, {1, 1, 1, static_cast<std::int64_t>(values.size())});
  std::ranges::copy(values, t.mutable_data<double>().begin());
  return t;
}

}  // namespace

TEST_CASE("mirroring agrees with PyTorch, and its kernel with the definition, exactly") {
  const SafetensorsFile golden = SafetensorsFile::open(SLIDE_TEST_DATA "/ops/fill.safetensors");
  for (const char* name : {"odd", "row", "column", "even", "empty", "pixel"}) {
    CAPTURE(name);
    const auto tensor = [&](const char* what) { return golden.tensor(std::string(name) + "." + what); };
    const Call call = mirror_call(tensor("x"), tensor("weight"));
    CHECK(max_abs_difference(call.reference(), tensor("mirrored")) == 0);
    CHECK(test::check_kernels(call) > 0);
  }
}

TEST_CASE(
    "a row is mirrored at both ends of a gap; the middle goes to the left; beyond the border it comes back") {
  const Tensor x = row({1, 2, 3, -1, -2, -3, 4, 5, -4, -5, -6});
  const Tensor weight = row({1, 1, 0.5, 0, 0, 0.4, 1, 1, 0, 0, 0});
  const std::vector<double> wanted = {1, 2, 3, 2, 1, 5, 4, 5, 4, -3, -2};
  const Tensor y = mirror_call(x, weight).reference();
  for (std::size_t i = 0; i < wanted.size(); ++i) CHECK(y.data<double>()[i] == wanted[i]);
  CHECK(test::check_kernels(mirror_call(x, weight)) > 0);
  const Tensor back = mirror_call(row({7, 8, 9}), row({1, 0, 0})).reference();
  CHECK(back.data<double>()[1] == 8);
  CHECK(back.data<double>()[2] == 9);
}

TEST_CASE(
    "of equally near pixels the first row counts, then the first column; large pictures, sparse and empty") {
  for (const int every : {1, 7, 501, 1 << 30}) {
    CAPTURE(every);
    Tensor weight = Tensor::zeros(DType::kF64, {2, 1, 61, 150});
    for (std::size_t i = 0; i < weight.data<double>().size(); ++i)
      weight.mutable_data<double>()[i] = i % static_cast<std::size_t>(every) == 3 ? 1 : 0.3;
    CHECK(test::check_kernels(mirror_call(test::random_tensor({2, 3, 61, 150}, 4), weight)) > 0);
  }
}

TEST_CASE("holes with known pixels in them, and whole rows and columns without any") {
  Tensor weight = test::random_tensor({1, 1, 83, 97}, 9);
  for (std::size_t i = 0; i < weight.data<double>().size(); ++i) {
    const bool outside = i / 97 < 20 || i / 97 >= 60 || i % 97 < 30 || i % 97 >= 80;
    double& w = weight.mutable_data<double>()[i];
    w = i / 97 == 70 || i % 97 == 90 ? 0 : outside ? 1 : w > 0.98 ? 1 : 0;
  }
  CHECK(test::check_kernels(mirror_call(test::random_tensor({1, 2, 83, 97}, 4), weight)) > 0);
  CHECK(test::check_kernels(
            mirror_call(test::random_tensor({1, 2, 83, 97}, 5), test::random_tensor({1, 1, 83, 97}, 6))) > 0);
}

TEST_CASE("mirroring refuses a weight of another size") {
  Graph g;
  const Value x = g.input("x", {1, 3, 8, 8});
  CHECK_THROWS_AS((void)ops::mirror_known(x, x), Error);
}
