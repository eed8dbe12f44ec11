/* Answers of WLED. */
#include "fuzz.h"
#include "network/wled_http.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct wled_answer answer = {0};
    g_autoptr(GError) error = NULL;
    if (wled_answer_read((const char *)data, (gssize)size, &answer, &error))
        g_assert_cmpint(answer.n_leds, >=, 0);
    else
        g_assert_nonnull(error);
    return 0;
}
