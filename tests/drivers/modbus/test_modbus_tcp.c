#include "lib/modbus_rig.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

/* Carries out what fail() asks for, until the input ends. */
static void serve_faults(VirtualModbus *device, int input, int output) {
    for (char fault; read(input, &fault, 1) == 1;) {
        modbus_rig_fail(device, (enum conformance_fault)fault);
        if (write(output, &fault, 1) != 1)
            return;
    }
}

struct served {
    int input, output;
};

static void fail(gpointer data, enum conformance_fault fault) {
    const struct served *served = data;
    char sent = (char)fault, done = -1;
    g_assert_cmpint(write(served->input, &sent, 1), ==, 1);
    g_assert_cmpint(read(served->output, &done, 1), ==, 1);
    g_assert_cmpint(done, ==, sent);
}

/* A device in a process of its own, since the suites count this one's open files. It ends with its
 * input. Returns where it can be reached; g_free(). */
static char *serve(struct served *ret) {
    int input[2], output[2];
    char bus[64] = "";
    g_assert_cmpint(pipe2(input, O_CLOEXEC), ==, 0);
    g_assert_cmpint(pipe2(output, O_CLOEXEC), ==, 0);
    pid_t child = fork();
    g_assert_cmpint(child, >=, 0);
    if (child == 0) {
        VirtualModbus *device = modbus_rig_device(FALSE);
        const char *name = virtual_modbus_bus(device);
        close(input[1]);
        gboolean ok = write(output[1], name, strlen(name)) > 0;
        serve_faults(device, input[0], output[1]);
        _exit(!ok);
    }
    close(input[0]);
    close(output[1]);
    g_assert_cmpint(read(output[0], bus, sizeof bus - 1), >, 0);
    *ret = (struct served){input[1], output[0]};
    return g_strdup(bus);
}

int main(int argc, char **argv) {
    static struct served served;
    g_autofree char *bus = serve(&served);
    g_test_init(&argc, &argv, NULL);
    modbus_rig_conformance(bus, "modbus-tcp", fail, &served);
    modbus_rig_conformance_watchdog(bus, "modbus-tcp-register", FALSE, fail, &served);
    modbus_rig_conformance_watchdog(bus, "modbus-tcp-pulses", TRUE, fail, &served);
    int result = g_test_run();
    close(served.input);
    close(served.output);
    wait(NULL);
    return result;
}
