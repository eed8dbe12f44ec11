/* The text of a recording: its lines, what it leaves out, and that it can be read again. */
#include "drivers/recording.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "virtual/replay/recorded.h"

#include <string.h>

static const struct recording_bus port = {"serial", "/dev/ttyUSB7"};

static void assert_has(const char *text, const char *words) {
    if (!strstr(text, words))
        g_error("“%s” is not in:\n%s", words, text);
}

static void assert_lacks(const char *text, const char *words) {
    if (strstr(text, words))
        g_error("“%s” is in:\n%s", words, text);
}

TEST(off) {
    recording_text(port, RECORDING_SENT, "?", 1);
    recording_device("axis a", "home");
    g_assert_null(recording_end());
    recording_begin();
    g_assert_true(recording_is_on());
    g_autofree char *text = recording_end();
    g_assert_false(recording_is_on());
    assert_lacks(text, "home");
    g_assert_null(recording_end());
}

/* Lines of the device are recorded when they are complete, in whatever pieces they arrive. */
TEST(lines) {
    static const guint8 bytes[] = {1, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255};
    recording_begin();
    recording_text(port, RECORDING_SENT, "G0 \"X\"\\\t\x18\xc3\n", 11);
    recording_text(port, RECORDING_RECEIVED, "o", 1);
    recording_note(port, "%s", "no answer");
    recording_text(port, RECORDING_RECEIVED, "k\r\nerr", 6);
    recording_bytes((struct recording_bus){"udp", "10.0.0.7"}, RECORDING_SENT, bytes, sizeof bytes);
    recording_device("axis a", "= fault: %s", "two\nlines");
    g_autofree char *text = recording_end();
    static const char *const lines[] = {
        "\n@1 = serial\n@2 = udp\n", " @1 > \"G0 \\\"X\\\"\\\\\\t\\x18\\xc3\\n\"\n",
        " @1 - \"no answer\"\n",     " @1 < \"ok\\r\\n\"\n",
        " @2 > 01 02 02 00*9 ff\n",  " [axis a] = fault: two lines\n",
        " @1 < \"err\"\n",
    };
    const char *at = text;
    for (gsize i = 0; i < G_N_ELEMENTS(lines); i++) {
        assert_has(at, lines[i]);
        at = strstr(at, lines[i]);
    }
    g_autoptr(Recorded) read = ok(recorded_parse(text, "text", ERR));
    g_assert_cmpuint(read->lines->len, ==, 6);
    const struct recorded_line *first = read->lines->pdata[0], *packet = read->lines->pdata[3];
    gsize n;
    g_assert_cmpmem(g_bytes_get_data(first->bytes, NULL), g_bytes_get_size(first->bytes),
                    "G0 \"X\"\\\t\x18\xc3\n", 11);
    const guint8 *read_bytes = g_bytes_get_data(packet->bytes, &n);
    g_assert_cmpmem(read_bytes, n, bytes, sizeof bytes);
    g_assert_cmpint(packet->way, ==, '>');
    g_assert_cmpint(packet->bus, ==, 2);
}

/* Devices of other people in the network are not recorded. */
TEST(strangers) {
    recording_begin();
    recording_bytes((struct recording_bus){"udp", "10.0.0.8"}, RECORDING_RECEIVED,
                    (const guint8 *)"\1", 1);
    g_autofree char *text = recording_end();
    assert_lacks(text, "udp");
}

TEST(hidden) {
    static const guint8 mac[] = {0x00, 0x1b, 0xc5, 0x12, 0x34, 0x56};
    static const guint8 reply[] = {0, 0, 0,    0,    0,    0,    0,    0,
                                   0, 0, 0x00, 0x1b, 0xc5, 0x12, 0x34, 0x56};
    static const guint8 packet[] = {'S', 'N',  '4',  '7',  '1',  '1',  0xff, 'S', 0,
                                    'N', 0,    '4',  0,    '7',  0,    '1',  0,   '1',
                                    0,   0x00, 0x1b, 0xc5, 0x12, 0x34, 0x56};
    g_autoptr(Config) config =
        ok(config_parse("[axis a]\ndriver = gcode-axis\nport = /dev/ttyUSB7\nletter = X\n"
                        "serial = SN4711\nspeed_deg_s = 5\nlocal_address = 10.1.2.3\n",
                        "rig.conf", ERR));
    gsize n;
    recording_begin();
    recording_section(config_sections(config, &n));
    g_autofree char *line = g_strdup_printf("%s at %s on %s has SN4711\n", g_get_home_dir(),
                                            port.address, g_get_host_name());
    recording_text(port, RECORDING_RECEIVED, line, strlen(line));
    recording_bytes(port, RECORDING_RECEIVED, packet, sizeof packet);
    recording_bytes(port, RECORDING_RECEIVED, reply, sizeof reply);
    recording_device("axis a", "= failed: 10.1.2.3 is no address");
    recording_hide("SN4711", NULL);
    recording_hide("7", NULL); /* too short: it could be part of anything */
    recording_hide_bytes(mac, sizeof mac);
    g_autofree char *text = recording_end();
    static const char *const personal[] = {"SN4711", "ttyUSB7", "53 4e 34", "53 00 4e 00",
                                           "1b c5 12"};
    for (gsize i = 0; i < G_N_ELEMENTS(personal); i++)
        assert_lacks(text, personal[i]);
    if (strlen(g_get_host_name()) >= 4)
        assert_lacks(text, g_get_host_name());
    assert_has(text, "\n[axis a]\ndriver = gcode-axis\nport = @1\nletter = X\n"
                     "# serial = left out\nspeed_deg_s = 5\n# local_address = left out\n");
    assert_lacks(text, "10.1.2.3");
    assert_has(text, " @1 < 00*11 00 00 00 00 00\n");
    assert_has(text, "\"{home} at @1 on ");
    assert_has(text, "has XXXXXX\\n\"");
    assert_has(text, "58 58 58 58 58 58 ff 58 00 58 00 58 00 58 00 58 00 58 00 00 00 00 00 00 00");
    g_autoptr(Recorded) read = ok(recorded_parse(text, "text", ERR));
}

/* A recording that is left on does not fill the memory. */
TEST(limit) {
    g_autofree char *line = g_strnfill(1 << 20, 'a');
    line[(1 << 20) - 1] = '\n';
    recording_begin();
    for (int i = 0; i < 40; i++)
        recording_text(port, RECORDING_RECEIVED, line, 1 << 20);
    g_autofree char *text = recording_end();
    g_assert_cmpuint(strlen(text), <, 34 << 20);
    g_assert_true(g_str_has_suffix(text, "\n# It is cut off here, at 32 MiB.\n"));
}
