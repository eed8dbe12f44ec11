/* Answers of Art-Net nodes. Identity and OpCode are corrected, so that the fields are reached. */
#include "fuzz.h"
#include "network/artnet_packet.h"

#include <string.h>

static void check(const guint8 *bytes, gsize n) {
    struct artnet_reply reply;
    if (!artnet_reply_read(bytes, n, &reply))
        return;
    g_assert_cmpint(strlen(reply.name), <, sizeof reply.name);
    for (const char *at = reply.name; *at; at++)
        g_assert_true(g_ascii_isprint(*at));
    g_assert_cmpint(reply.n, >=, 0);
    g_assert_cmpint(reply.n, <=, ARTNET_PORTS);
    for (int i = 0; i < reply.n; i++) {
        g_assert_cmpint(reply.outputs[i].universe, >=, 0);
        g_assert_cmpint(reply.outputs[i].universe, <=, ARTNET_MAX_UNIVERSE);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const guint8 head[] = {'A', 'r', 't', '-', 'N', 'e', 't', 0, 0x00, 0x21};
    check(data, size);
    if (size < sizeof head)
        return 0;
    g_autofree guint8 *corrected = g_memdup2(data, size);
    memcpy(corrected, head, sizeof head);
    check(corrected, size);
    return 0;
}
