/* A controller in C in shared memory: a share of what it senses, sample by sample.
 *
 * Its way onto the bus is ring_controller.py, which starts it with an open segment:
 *     ring_controller FD RUN_ID FIRST_SAMPLE LATENCY_STEPS GAIN
 * It writes every force (8 bytes) to its standard output as well, for the recorder, and ends with 0
 * after the last one, with 1 when the run is over before, with 2 when something was lost.
 * Build: cc -O2 -I FOLDER_OF_hertzloop_ring.h -o ring_controller ring_controller.c
 */
#define _GNU_SOURCE
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "hertzloop_ring.h"

/* Look again: at once, then after others have run, then after a while; 0 once the plant has left. */
static int again(hertzloop_ring *lane, long tries) {
    if (tries > 2000) {
        if (atomic_load(&lane->closed)) return 0;
        if (tries < 4000) sched_yield();
        else usleep(50);
    }
    return 1;
}

int main(int count, char **given) {
    if (count != 6) return 2;
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* nobody would tell it that the run is over */
    int fd = atoi(given[1]);
    int64_t run_id = strtoll(given[2], NULL, 10), sample = strtoll(given[3], NULL, 10);
    int64_t latency = strtoll(given[4], NULL, 10), put = 0;
    double gain = atof(given[5]), value, force;
    struct stat found;
    if (fstat(fd, &found)) return 2;
    size_t size = (size_t)found.st_size;
    hertzloop_ring *lane = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (lane == MAP_FAILED || lane->magic != HERTZLOOP_RING_MAGIC || lane->run_id != run_id ||
        lane->version != HERTZLOOP_RING_VERSION || hertzloop_ring_bytes(lane->slots) != size)
        return 2;
    atomic_store(&lane->joined, run_id);
    int64_t every = lane->every_steps, samples = (lane->steps + every - 1) / every;
    int64_t step = sample * every + 1 + latency; /* the forces before it went over the bus */
    if (step > lane->steps) step = lane->steps;
    for (; sample < samples; sample++) {
        int said;
        for (long tries = 0; !(said = hertzloop_ring_sample(lane, sample, &value)); tries++)
            if (!again(lane, tries)) return 1;
        if (said < 0) return 2;
        force = gain * value; /* acts until the next sample's does, or the run ends */
        int64_t end = (sample + 1) * every + 1 + latency;
        if (end > lane->steps) end = lane->steps;
        do { /* a record a step, the last of them with the sample that it answers */
            int gives = step < end, last = step + 1 >= end;
            for (long tries = 0; !hertzloop_ring_answer(
                     lane, &put, sample + last, gives ? force : NAN, NAN); tries++)
                if (!again(lane, tries)) return 1;
            if (gives && fwrite(&force, sizeof force, 1, stdout) != 1) return 1;
            step += gives;
        } while (step < end);
    }
    return fflush(stdout) ? 1 : 0;
}
