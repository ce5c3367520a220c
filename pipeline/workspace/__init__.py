"""What happens around the stages: composed scales, stray files, system libraries. No stage imports this."""
