// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// SPDX-License-Identifier: GPL-2.0
/*
 * Faults of a CAN controller that QEMU does not emulate: it has no acknowledgement, no bit timing and no bus-off.
 *
 *   echo "can0 bus-off" > /sys/module/can_faults/parameters/inject
 *
 * A controller that is bus-off receives nothing until it is restarted; the CAN core restarts it, after restart-ms.
 */
#include <linux/can/dev.h>
#include <linux/can/error.h>
#include <linux/can/skb.h>
#include <linux/module.h>
#include <linux/netdevice.h>
#include <linux/rtnetlink.h>

static rx_handler_result_t receive(struct sk_buff **pointer)
{
	struct sk_buff *skb = *pointer;
	const struct can_priv *priv = netdev_priv(skb->dev);
	const struct can_frame *frame = (const struct can_frame *)skb->data;

	if (priv->state != CAN_STATE_BUS_OFF || (frame->can_id & CAN_ERR_FLAG))
		return RX_HANDLER_PASS;
	kfree_skb(skb);
	return RX_HANDLER_CONSUMED;
}

static int report_state(struct net_device *dev, enum can_state state)
{
	struct can_priv *priv = netdev_priv(dev);
	struct can_frame *frame;
	struct sk_buff *skb = alloc_can_err_skb(dev, &frame);

	if (!skb)
		return -ENOMEM;
	if (priv->state != state)
		can_change_state(dev, frame, state, state);
	if (state == CAN_STATE_BUS_OFF) {
		if (!netdev_is_rx_handler_busy(dev))
			netdev_rx_handler_register(dev, receive, NULL);
		can_bus_off(dev);
	}
	netif_rx(skb);
	return 0;
}

static int report_bit_error(struct net_device *dev)
{
	struct can_frame *frame;
	struct sk_buff *skb = alloc_can_err_skb(dev, &frame);

	if (!skb)
		return -ENOMEM;
	frame->can_id |= CAN_ERR_PROT | CAN_ERR_BUSERROR;
	frame->data[2] = CAN_ERR_PROT_STUFF;
	netif_rx(skb);
	return 0;
}

static int inject_into(struct net_device *dev, const char *fault)
{
	if (!safe_candev_priv(dev) || !netif_running(dev))
		return -ENETDOWN;
	if (!strcmp(fault, "bus-off"))
		return report_state(dev, CAN_STATE_BUS_OFF);
	if (!strcmp(fault, "passive"))
		return report_state(dev, CAN_STATE_ERROR_PASSIVE);
	if (!strcmp(fault, "bit-error"))
		return report_bit_error(dev);
	if (!strcmp(fault, "stall")) /* as without a node that acknowledges */
		netif_stop_queue(dev);
	else if (!strcmp(fault, "resume"))
		netif_wake_queue(dev);
	else
		return -EINVAL;
	return 0;
}

static int inject(const char *text, const struct kernel_param *parameter)
{
	char name[IFNAMSIZ], fault[16];
	struct net_device *dev;
	int result;

	if (sscanf(text, "%15s %15s", name, fault) != 2)
		return -EINVAL;
	dev = dev_get_by_name(&init_net, name);
	if (!dev)
		return -ENODEV;
	rtnl_lock();
	result = inject_into(dev, fault);
	rtnl_unlock();
	dev_put(dev);
	return result;
}

static const struct kernel_param_ops operations = { .set = inject };
module_param_cb(inject, &operations, NULL, 0200);
MODULE_PARM_DESC(inject, "device and fault: bus-off, passive, bit-error, stall or resume");

MODULE_DESCRIPTION("Faults of CAN controllers for tests");
MODULE_LICENSE("GPL");
