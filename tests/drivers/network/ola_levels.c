/* The packets of artnet-lamps and sacn-lamps as olad, the daemon of the Open Lighting Architecture,
 * reads them. olad tells its levels by HTTP. The test runs in a name space with a network of its
 * own. olad is behind a cable, in another network, because it takes the ports of both protocols. It
 * does not run as root. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "network/devices.h"

#include <json-glib/json-glib.h>
#include <stdio.h>
#include <string.h>

#define CHILD     "MESORIG_OLA_CHILD"
#define OWN       "192.0.2.50"
#define NODE      "192.0.2.51"
#define HTTP_PORT "9190"

struct bench {
    GSubprocess *olad;
    char *enter; /* argument of nsenter for the network of olad */
    Clock *clock;
    LampBank *bank;
    int n_events;
    GError *error;
};

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n_events++;
    if (error && !bench->error)
        bench->error = g_error_copy(error);
}

/* Returns the JSON of a page of olad, or NULL if it does not answer. */
static char *get(const char *page) {
    g_autofree char *url = g_strdup_printf("http://" NODE ":" HTTP_PORT "/%s", page);
    char *text = NULL;
    if (process_run((const char *[]){"curl", "-sf", "--max-time", "5", url, NULL}, &text, NULL) ==
        0)
        return text;
    g_free(text);
    return NULL;
}

/* Reads the levels of a universe of olad. Levels that olad has not received are 0. */
static void read_levels(int universe, guint8 ret[512]) {
    g_autofree char *page = g_strdup_printf("get_dmx?u=%d", universe);
    g_autofree char *text = get(page);
    g_assert_nonnull(text);
    g_autoptr(JsonNode) root = json_from_string(text, NULL);
    JsonArray *levels = json_object_get_array_member(json_node_get_object(root), "dmx");
    memset(ret, 0, 512);
    for (guint i = 0; i < MIN(json_array_get_length(levels), 512); i++)
        ret[i] = (guint8)json_array_get_int_element(levels, i);
}

static void start_olad(struct bench *bench, const char *folder) {
    text_file_write(folder, "ola-artnet.conf", "enabled = true\nip = " NODE "\n");
    text_file_write(folder, "ola-e131.conf", "enabled = true\nip = " NODE "\ninput_ports = 4\n");
    g_autofree char *log = g_build_filename(folder, "log", NULL);
    bench->olad = process_start(
        G_SUBPROCESS_FLAGS_STDOUT_SILENCE, log,
        (const char *[]){"unshare", "--net", "sh", "-ec",
                         "until ip link show mesorig1 > /dev/null 2>&1; do sleep 0.05; done\n"
                         "ip link set lo up\n"
                         "ip address add " NODE "/24 broadcast + dev mesorig1\n"
                         "ip link set mesorig1 up\n"
                         "exec olad -c \"$0\" -p " HTTP_PORT " --no-register-with-dns-sd",
                         folder, NULL});
    const char *number = g_subprocess_get_identifier(bench->olad);
    g_autofree char *network = g_strdup_printf("/proc/%s/ns/net", number);
    g_autofree char *own = g_file_read_link("/proc/self/ns/net", NULL);
    for (gboolean entered = FALSE; !entered; g_usleep(1000)) {
        g_autofree char *its = g_file_read_link(network, NULL);
        entered = its && strcmp(its, own) != 0;
    }
    bench->enter = g_strdup_printf("--net=%s", network);
    g_free(
        process_text(0, (const char *[]){"ip", "link", "set", "mesorig1", "netns", number, NULL}));
    char *text = NULL;
    UNTIL ((text = get("json/server_stats")))
        g_usleep(50000);
    g_free(text);
}

/* Connects an input of olad with one of its universes. */
static void patch(const struct bench *bench, const char *plugin, int universe) {
    g_autofree char *devices =
        process_text(0, (const char *[]){"nsenter", bench->enter, "ola_dev_info", NULL});
    g_auto(GStrv) lines = g_strsplit(devices, "\n", -1);
    g_autofree char *number = g_strdup_printf("%d", universe);
    for (int i = 0; lines[i]; i++) {
        int device;
        if (strstr(lines[i], plugin) && sscanf(lines[i], "Device %d", &device) == 1) {
            g_autofree char *text = g_strdup_printf("%d", device);
            g_free(process_text(0, (const char *[]){"nsenter", bench->enter, "ola_patch", "-d",
                                                    text, "-p", "0", "-i", "-u", number, NULL}));
            return;
        }
    }
    g_error("olad has no device %s:\n%s", plugin, devices);
}

static void expect_levels(int universe, const guint8 wanted[512]) {
    guint8 levels[512];
    read_levels(universe, levels);
    UNTIL (memcmp(levels, wanted, 512) == 0)
        read_levels(universe, levels);
}

static void set_lamp(struct bench *bench, int index, gboolean on) {
    bench->n_events = 0;
    if (index < 0)
        lamps_all_off(bench->bank, NULL);
    else
        lamps_set(bench->bank, index, on, NULL);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_no_error(bench->error);
}

/* Switches lamps of 16 bits with a further channel, and reads all channels of the universe. */
static void compare(struct bench *bench, const struct lamps_driver *driver, const char *keys,
                    int universe) {
    static const guint8 values[] = {0x12, 0x34, 77};
    guint8 wanted[512] = {0};
    const struct config_section *section;
    g_autofree char *text =
        g_strdup_printf("[lamps test]\ndriver = %s\nuniverse = %d\nn = 150\nbits = 16\n"
                        "levels = 4660\nother_values = 77\nstart = 10\n%s",
                        driver->info.name, universe, keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    bench->bank = ok(lamps_open(driver, section, NULL, bench->clock, ERR));
    lamps_listen(bench->bank, on_lamp, bench);
    expect_levels(universe, wanted);
    static const int lamps[] = {0, 7, 149};
    gint64 longest_us = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(lamps); i++) {
        const gint64 begun = g_get_monotonic_time();
        set_lamp(bench, lamps[i], TRUE);
        longest_us = MAX(longest_us, g_get_monotonic_time() - begun);
        memcpy(wanted + 9 + 3 * lamps[i], values, sizeof values);
        expect_levels(universe, wanted);
    }
    g_test_message("%s: a switch takes at most %.0f ms", driver->info.name,
                   (double)longest_us / 1000);
    set_lamp(bench, 7, FALSE);
    memset(wanted + 9 + 3 * 7, 0, sizeof values);
    expect_levels(universe, wanted);
    set_lamp(bench, -1, FALSE);
    memset(wanted, 0, sizeof wanted);
    expect_levels(universe, wanted);
    set_lamp(bench, 3, TRUE);
    lamps_close(g_steal_pointer(&bench->bank)); /* switches off */
    expect_levels(universe, wanted);
}

/* Runs in a network of its own. */
TEST(child) {
    if (!g_getenv(CHILD))
        return;
    TEMPORARY_FOLDER(folder);
    struct bench bench = {.clock = clock_new_real()};
    start_olad(&bench, folder);
    patch(&bench, "ArtNet", 1);
    patch(&bench, "E1.31", 2);
    compare(&bench, &artnet_lamps_driver, "address = " NODE "\n", 1);
    compare(&bench, &artnet_lamps_driver, "address = " NODE "\nlocal_address = " OWN "\n", 1);
    compare(&bench, &sacn_lamps_driver, "address = " NODE "\n", 2);
    compare(&bench, &sacn_lamps_driver, "local_address = " OWN "\n", 2);
    g_subprocess_force_exit(bench.olad);
    g_subprocess_wait(bench.olad, NULL, NULL);
    g_object_unref(bench.olad);
    clock_unref(bench.clock);
    g_free(bench.enter);
}

TEST(levels) {
    static const char *const programs[] = {"olad", "ola_patch", "ip", "unshare", "nsenter", "curl"};
    for (gsize i = 0; i < G_N_ELEMENTS(programs); i++) {
        g_autofree char *path = g_find_program_in_path(programs[i]);
        if (!path) {
            g_autofree char *reason = g_strdup_printf("%s is not installed", programs[i]);
            test_skip_or_fail(reason);
            return;
        }
    }
#define IN_NETWORK "unshare", "--user", "--map-user=65534", "--keep-caps", "--net"
    if (process_run((const char *[]){IN_NETWORK, "true", NULL}, NULL, NULL) != 0) {
        test_skip_or_fail("no name spaces of networks");
        return;
    }
    g_autofree char *own = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *said =
        process_text(0, (const char *[]){IN_NETWORK, "sh", "-ec",
                                         "ip link set lo up\n"
                                         "ip link add mesorig0 type veth peer name mesorig1\n"
                                         "ip address add " OWN "/24 broadcast + dev mesorig0\n"
                                         "ip link set mesorig0 up\n"
                                         "ip link set mesorig1 up\n"
                                         "export " CHILD "=1\n"
                                         "exec \"$0\" -p /ola-levels/child",
                                         own, NULL});
    g_test_message("%s", said);
    assert_has(said, "ok 1 /ola-levels/child");
}
