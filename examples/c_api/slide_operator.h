/* An operator of your own for `slide_check judge CASE --library ./mine.so`: a shared library with the one
 * function declared here, in C or anything that can be called from C.
 *
 *   cc -O2 -shared -fPIC -I examples/c_api mine.c -o mine.so
 */
#ifndef SLIDE_SLIDE_OPERATOR_H
#define SLIDE_SLIDE_OPERATOR_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* float32, row-major, without gaps; extents[0] is the slowest axis. */
typedef struct slide_operator_tensor {
  const char* name; /* as in docs/operators.md: "x", "weight" */
  const float* data;
  const int64_t* extents;
  int32_t rank;
} slide_operator_tensor;

/* Computes one call. `op` and `attributes`, a JSON object, are those of the case (docs/operators.md); inputs
 * come in the case's order. `output` has as many numbers as output_extents multiply to, all NaN before, and
 * is not aligned beyond a float's own needs.
 * Returns 0; anything else says that the library cannot do this call.
 */
int slide_operator(const char* op, const char* attributes, const slide_operator_tensor* inputs,
                   int32_t input_count, float* output, const int64_t* output_extents, int32_t output_rank);

#ifdef __cplusplus
}
#endif

#endif
