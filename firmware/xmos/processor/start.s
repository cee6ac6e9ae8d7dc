# The beginning: memory, pins, resources, threads. The thread that begins goes on as the one that handles messages.
#
# The boot program has put the program at the beginning of memory, and leaves the unique number in r0 and r1, low word
# first. It has set up the link to the controller.

    .set OUTPUT_PORT, 0x200000      # 32A
    .set SYNC_PORT, 0x10400         # 1F
    .set SUPPLY_PORT, 0x10500       # 1G: 1 while the supply is within 12 to 18 V
    .set TEMPERATURE_PORT, 0x80200  # 8C: degrees Celsius, signed
    .set MESSAGE_ENDS, 20           # 1 to 6 are those of the chain; the others take what is for nobody
    .set OUTPUT_DIVIDE, 25          # half a tick, in cycles of 10 ns

    .set PORT_STACK, 2              # words
    .set RECEIVE_STACK, 2
    .set PLAY_STACK, 64
    .set HANDLE_STACK, 64
    .globl PORT_STACK
    .globl RECEIVE_STACK
    .globl PLAY_STACK
    .globl HANDLE_STACK
    .globl MESSAGE_ENDS

    # Not among the data that begin as 0, which are cleared when the resources are there already. What is near the
    # beginning of the data is reached by shorter instructions: the playing thread's come first.
    .section .dp.data.resources,"awd",@progbits
    .p2align 2
    .globl play_timer
play_timer:
    .long 0
    .globl play_clock
play_clock:
    .long 0
    .globl play_inbox
play_inbox:
    .long 0
    .globl play_ready
play_ready:
    .long 0
    .globl started_to
started_to:
    .long 0
    .globl state_lock
state_lock:
    .long 0
    .globl sync_port
sync_port:
    .long 0
    .globl supply_port
supply_port:
    .long 0
    .globl temperature_port
temperature_port:
    .long 0
    .section .dp.data.large.resources,"awd",@progbits
    .p2align 2
    .globl config_end
config_end:
    .long 0
    .globl message_ends
message_ends:
    .space 80
    .globl receive_play
receive_play:
    .long 0
    .globl receive_play_ready
receive_play_ready:
    .long 0
    .globl receive_handle
receive_handle:
    .long 0
    .globl receive_handle_ready
receive_handle_ready:
    .long 0
    .globl handle_inbox
handle_inbox:
    .long 0
    .globl handle_ready
handle_ready:
    .long 0
    .globl started_from
started_from:
    .long 0
    .globl answer_end
answer_end:
    .long 0
    .globl handle_timer
handle_timer:
    .long 0
    .globl handle_clock
handle_clock:
    .long 0
    .globl receive_clock
receive_clock:
    .long 0
    .globl port_clock
port_clock:
    .long 0
    .globl output_port
output_port:
    .long 0
    .globl output_clock
output_clock:
    .long 0
    .globl unique_id
unique_id:
    .space 8

    .section .dp.bss.large.stacks,"awd",@nobits
    .p2align 2
    # A stack grows down; the word at its label is the first to be used.
    .space 4 * PORT_STACK
port_stack:
    .long 0
    .space 4 * RECEIVE_STACK
receive_stack:
    .long 0
    .space 4 * PLAY_STACK
play_stack:
    .long 0
    .space 4 * HANDLE_STACK
handle_stack:
    .long 0

    .section .cp.rodata.version,"ac",@progbits
    .p2align 2
    .globl firmware_version
firmware_version:
    .byte VERSION_MAJOR
    .byte VERSION_MINOR
    .byte VERSION_PATCH
    .byte 0

    .section .cp.rodata.ports,"ac",@progbits
    .p2align 2
ports:
    .long OUTPUT_PORT
    .long SYNC_PORT
    .long SUPPLY_PORT
    .long TEMPERATURE_PORT

    .text
    .globl start
    .p2align 2
    .type start,@function
    .cc_top start.function,start
start:
    ldap r11, _cp
    set cp, r11
    ldap r11, _dp
    set dp, r11

    # The outputs are low before anything else (SAF-001). What comes to a channel end before there is one is lost.
    ldaw r11, cp[ports]
    ldw r2, r11[0]
    setc res[r2], 8
    ldc r3, 0
    out res[r2], r3
    stw r0, dp[unique_id]
    stw r1, dp[unique_id+4]
    ldaw r11, dp[handle_stack]
    set sp, r11
    bl get_resources

    # Memory that begins as 0.
    ldc r3, 0
    ldap r11, _bss
    mov r4, r11
    ldap r11, _end
.Lclear:
    stw r3, r4[0]
    add r4, r4, 4
    lsu r5, r4, r11
    bt r5, .Lclear
    bl memories_begin
    bl play_begin
    bl handle_begin

    ldap r11, port
    ldaw r1, dp[port_stack]
    bl begin_thread
    ldap r11, receive
    ldaw r1, dp[receive_stack]
    bl begin_thread
    ldap r11, play
    ldaw r1, dp[play_stack]
    bl begin_thread
    bl handle
    waiteu
    .cc_bottom start.function

    .p2align 2
    .type begin_thread,@function
    .cc_top begin_thread.function,begin_thread
# r11 where it begins, r1 its stack.
begin_thread:
    getr r0, 4
    init t[r0]:pc, r11
    init t[r0]:sp, r1
    ldap r11, _cp
    init t[r0]:cp, r11
    ldap r11, _dp
    init t[r0]:dp, r11
    start t[r0]
    retsp 0
    .cc_bottom begin_thread.function

    .p2align 2
    .type get_resources,@function
    .cc_top get_resources.function,get_resources
# Channel ends come in the order of their numbers, so 0 is that for the switch, and 1 to 6 are those of CHN-009.
get_resources:
    getr r0, 2
    stw r0, dp[config_end]
    ldaw r1, dp[message_ends]
    ldc r2, MESSAGE_ENDS
    ldc r3, 0
.Lends:
    getr r0, 2
    stw r0, r1[r3]
    add r3, r3, 1
    eq r0, r3, r2
    bf r0, .Lends
    getr r0, 2
    stw r0, dp[receive_play]
    getr r0, 2
    stw r0, dp[receive_play_ready]
    getr r0, 2
    stw r0, dp[receive_handle]
    getr r0, 2
    stw r0, dp[receive_handle_ready]
    getr r0, 2
    stw r0, dp[play_inbox]
    getr r0, 2
    stw r0, dp[play_ready]
    getr r0, 2
    stw r0, dp[handle_inbox]
    getr r0, 2
    stw r0, dp[handle_ready]
    getr r0, 2
    stw r0, dp[started_from]
    getr r0, 2
    stw r0, dp[started_to]
    getr r0, 2
    stw r0, dp[answer_end]
    getr r0, 1
    stw r0, dp[play_timer]
    getr r0, 1
    stw r0, dp[play_clock]
    getr r0, 1
    stw r0, dp[handle_timer]
    getr r0, 1
    stw r0, dp[handle_clock]
    getr r0, 1
    stw r0, dp[receive_clock]
    getr r0, 1
    stw r0, dp[port_clock]
    getr r0, 5
    stw r0, dp[state_lock]

    ldaw r11, cp[ports]
    ldw r0, r11[0]
    stw r0, dp[output_port]
    ldw r1, r11[1]
    stw r1, dp[sync_port]
    setc res[r1], 8
    setc res[r1], 0x11              # equal to
    mkmsk r2, 1
    setd res[r1], r2
    ldw r1, r11[2]
    stw r1, dp[supply_port]
    setc res[r1], 8
    ldw r1, r11[3]
    stw r1, dp[temperature_port]
    setc res[r1], 8

    # The clock of the outputs: 2 MHz of the 100 MHz reference. It is not started yet.
    ldc r1, 0x106
    stw r1, dp[output_clock]
    setc res[r1], 8
    ldc r2, OUTPUT_DIVIDE
    setd res[r1], r2
    setclk res[r0], r1
    setc res[r0], 0x200F            # buffered
    retsp 0
    .cc_bottom get_resources.function
