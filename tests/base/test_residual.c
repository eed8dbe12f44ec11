#include "base/residual.h"
#include "lib/test.h"

#include <glib.h>

TEST(noise) {
    const struct residual noise = {"the plane", 0.0199, 0.01, "mm", "a bent sheet"};
    g_assert_null(residual_warning(&noise));
    const struct residual unknown = {"the plane", 5, 0, "mm", "a bent sheet"};
    g_assert_null(residual_warning(&unknown));
    g_assert_cmpfloat(residual_excess(&unknown), ==, 0);
    const struct residual small = {"the plane", 0.009, 0.01, "mm", "a bent sheet"};
    g_assert_cmpfloat(residual_excess(&small), ==, 0);
}

TEST(excess) {
    const struct residual bent = {"the sheet of “left”", 0.05, 0.03, "mm", "a bent sheet, speckle"};
    g_assert_cmpfloat_with_epsilon(residual_excess(&bent), 0.04, 1e-12);
    g_assert_null(residual_warning(&bent));
    const struct residual worse = {"the sheet of “left”", 0.07, 0.03, "mm",
                                   "a bent sheet, speckle"};
    g_autofree char *said = residual_warning(&worse);
    g_assert_cmpstr(
        said, ==,
        "the sheet of “left” fits with an error of 0.07 mm, but noise explains only 0.03 mm; "
        "possible causes: a bent sheet, speckle");
}
