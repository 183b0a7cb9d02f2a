// Attention at every level this CPU has, and the products by tiles everywhere, over tiles in plain code.

#include "ops/attention/attention.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "judge.h"
#include "ops/attention/attention_bf16.h"

namespace slide::ops::emulated_tiles {
extern const AttentionWordsRoutines attention_words;
}

using namespace slide;
using test::Call;
using test::random_tensor;

namespace {

const ops::AttentionBf16Kernel& emulated() {
  static const ops::AttentionBf16Kernel kernel("attention.emulated_tiles",
                                               ops::emulated_tiles::attention_words);
  return kernel;
}

struct Case {
  const char* what;
  std::int64_t heads, depth, value_depth, queries, keys;
};

/// Depths, queries and keys that fill tiles and vectors and that do not, and one, two and more blocks of
/// keys.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {{"whole tiles", 2, 64, 64, 64, 128},
                                        {"one key", 1, 4, 3, 5, 1},
                                        {"one query", 2, 32, 32, 1, 64},
                                        {"an odd depth, an odd number of keys", 3, 33, 5, 31, 129},
                                        {"one more than tiles hold", 1, 65, 33, 33, 33},
                                        {"three blocks of keys", 1, 16, 40, 40, 300},
                                        {"one less than tiles hold", 2, 31, 31, 63, 127}};
  return all;
}

Call attention_of(const Tensor& q, const Tensor& k, const Tensor& v, std::int64_t heads, double scale) {
  return {{q, k, v},
          [=](const std::vector<Value>& x) { return ops::attention(x[0], x[1], x[2], heads, scale); }};
}

Call call_of(const Case& c, double size) {
  const Tensor q = random_tensor({2, c.heads * c.depth, 1, c.queries}, 1, size);
  const Tensor k = random_tensor({2, c.heads * c.depth, 1, c.keys}, 2, size);
  const Tensor v = random_tensor({2, c.heads * c.value_depth, 1, c.keys}, 3);
  return attention_of(q, k, v, c.heads, 1 / std::sqrt(static_cast<double>(c.depth)));
}

void judge_all(const Call& call) {
  test::judge(call);
  const ops::KernelTask task = ops::make_task(*call.op, call.inputs);
  const ops::KernelCheck check = ops::check_kernel(emulated(), task, true);
  INFO(check.kernel, ": ", check.verdict(), ", ", check.of_bound, " of its bound");
  CHECK(check.passed());
}

}  // namespace

TEST_CASE("attention keeps its bounds wherever blocks, tiles and vectors end, for scores small and large") {
  for (const Case& c : cases())
    for (const double size : {0.1, 1.0, 4.0}) {
      INFO(c.what, ", size ", size);
      judge_all(call_of(c, size));
    }
}

TEST_CASE(
    "attention of the same value everywhere is this value: weights are divided by what they add up to") {
  const Case c{"", 2, 24, 5, 40, 300};
  const double value = 1.3125;  // exact in bfloat16
  const Tensor v =
      test::tensor_by({2, c.heads * c.value_depth, 1, c.keys}, [&](std::int64_t) { return value; });
  const Tensor q = random_tensor({2, c.heads * c.depth, 1, c.queries}, 1, 3);
  const Tensor k = random_tensor({2, c.heads * c.depth, 1, c.keys}, 2, 3);
  const Call call = attention_of(q, k, v, c.heads, 0.2);
  const ops::KernelTask task = ops::make_task(*call.op, call.inputs);
  const ops::KernelCheck check = ops::check_kernel(emulated(), task, true);
  // Rounded to bfloat16 by themselves, the weights' sum would be off by up to 2^-8. It is off by the sums'
  // roundings alone, each of at most 300 + 30.
  for (const float y : check.output.data<float>()) CHECK(std::fabs(y - value) <= 2 * 330 * 0x1p-24 * value);
  for (const Kernel* kernel : call.op->kernels()) {
    const std::vector<Isa> levels = available_isas();
    if (std::find(levels.begin(), levels.end(), kernel->isa()) == levels.end()) continue;
    const ops::KernelCheck own = ops::check_kernel(*kernel, task, false);
    INFO(own.kernel);
    double worst = 0;
    for (const float y : own.output.data<float>()) worst = std::max(worst, std::fabs(y - value));
    CHECK(worst <= 2 * 330 * 0x1p-24 * value);
  }
}

TEST_CASE("attention with a key or a value that is not finite: NaN never becomes a number") {
  const Case c{"", 1, 8, 6, 35, 40};
  for (const std::size_t input : {std::size_t{0}, std::size_t{1}, std::size_t{2}})
    for (const double bad :
         {std::nan(""), std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
      INFO("input ", input, ": ", bad);
      Tensor t[] = {random_tensor({2, c.depth, 1, c.queries}, 1), random_tensor({2, c.depth, 1, c.keys}, 2),
                    random_tensor({2, c.value_depth, 1, c.keys}, 3)};
      t[input].mutable_data<double>()[17] = bad;
      judge_all(attention_of(t[0], t[1], t[2], c.heads, 0.35));
    }
}
