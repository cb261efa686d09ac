"""Plants and controllers in processes of their own: messages, and transports that carry them.

Offers: controller_link, messages, own_clock, plant_link, plant_process, plant_rules, transport.
"""
