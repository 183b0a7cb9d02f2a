#include "graphs/slide_matte.h"

#include "graphs/slide_depth.h"
#include "ops/pointwise/pointwise.h"

namespace slide::graphs {

Value slide_matte(Value x) { return ops::sigmoid(slide_depth(x)); }

}  // namespace slide::graphs
