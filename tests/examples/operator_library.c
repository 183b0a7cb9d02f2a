/* relu for `slide_check judge --library`: right, or wrong in the way that a macro names. */
#include "examples/c_api/slide_operator.h"

#include <string.h>

int slide_operator(const char* op, const char* attributes, const slide_operator_tensor* inputs,
                   int32_t input_count, float* output, const int64_t* output_extents, int32_t output_rank) {
  if (strcmp(op, "relu") != 0) return 7;
  if (strcmp(attributes, "{}") != 0 || input_count != 1 || strcmp(inputs[0].name, "x") != 0) return 8;
  if (output_rank != inputs[0].rank) return 9;
  int64_t count = 1;
  for (int32_t k = 0; k < output_rank; ++k) {
    if (inputs[0].extents[k] != output_extents[k]) return 10;
    count *= output_extents[k];
  }
  for (int64_t i = 0; i < count; ++i) output[i] = inputs[0].data[i] > 0 ? inputs[0].data[i] : 0;
#if defined(LEAVES_LAST)
  output[count - 1] = -1;
#elif defined(WRITES_BEHIND)
  output[count] = 0;
#endif
  return 0;
}
