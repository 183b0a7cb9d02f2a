/* A convolution with a bug, for the tutorial in docs/slide_check.md: four columns at a time, as vectors would be. */
#include <stdlib.h>
#include <string.h>

#include "examples/c_api/slide_operator.h"

/* The numbers behind a key of the attributes, "stride":[2,1]. */
static void numbers(const char* json, const char* key, int count, long* out) {
  const char* at = strchr(strstr(json, key), '[') + 1;
  char* end;
  for (int i = 0; i < count; ++i, at = end + 1) out[i] = strtol(at, &end, 10);
}

int slide_operator(const char* op, const char* attributes, const slide_operator_tensor* in, int32_t inputs,
                   float* y, const int64_t* shape, int32_t rank) {
  long stride[2], dilation[2], padding[4];
  if (strcmp(op, "conv2d") != 0 || rank != 4 || strstr(attributes, "\"groups\":1}") == NULL) return 1;
  numbers(attributes, "\"stride\"", 2, stride);
  numbers(attributes, "\"dilation\"", 2, dilation);
  numbers(attributes, "\"padding\"", 4, padding);
  const int64_t *xs = in[0].extents, *ws = in[1].extents;
  const float* bias = inputs > 2 ? in[2].data : NULL;
  for (int64_t n = 0; n < shape[0]; ++n)
    for (int64_t k = 0; k < shape[1]; ++k)
      for (int64_t i = 0; i < shape[2]; ++i, y += shape[3])
        for (int64_t j0 = 0; j0 < shape[3]; j0 += 4) {
          const int64_t width = shape[3] - j0 < 4 ? shape[3] - j0 : 4;
          float sums[4];
          for (int64_t j = 0; j < 4; ++j) sums[j] = bias && width == 4 ? bias[k] : 0;
          for (int64_t c = 0; c < xs[1]; ++c)
            for (int64_t u = 0; u < ws[2]; ++u)
              for (int64_t v = 0; v < ws[3]; ++v)
                for (int64_t j = 0; j < width; ++j) {
                  const int64_t row = i * stride[0] - padding[0] + u * dilation[0];
                  const int64_t column = (j0 + j) * stride[1] - padding[1] + v * dilation[1];
                  if (row < 0 || row >= xs[2] || column < 0 || column >= xs[3]) continue;
                  sums[j] += in[0].data[((n * xs[1] + c) * xs[2] + row) * xs[3] + column] *
                             in[1].data[((k * ws[1] + c) * ws[2] + u) * ws[3] + v];
                }
          for (int64_t j = 0; j < width; ++j) y[j0 + j] = sums[j];
        }
  return 0;
}
